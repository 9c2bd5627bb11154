"""Files that appear under their name only once they are complete."""

from __future__ import annotations

import os
from pathlib import Path


class PartialFile:
    """A hidden file beside its target, renamed to it when complete.

    Args:
        target: where the file is to appear; the folder is made if needed. A symbolic link stays
            one: what it points to is replaced.
        under_its_name: write the target itself, for what is to be there while it grows; `commit`
            then does nothing.

    Attributes:
        path: of the hidden file, to write to.
    """

    def __init__(self, target: Path, *, under_its_name: bool = False) -> None:
        self._target = Path(os.path.realpath(target))
        self._target.parent.mkdir(parents=True, exist_ok=True)
        hidden = self._target.with_name(f".{self._target.name}.{os.getpid()}.partial")
        self.path = self._target if under_its_name else hidden

    def commit(self) -> None:
        """Let the file appear, in place of an older one."""
        self.path.replace(self._target)

    def discard(self) -> None:
        """Remove what was written; nothing happens after `commit`."""
        self.path.unlink(missing_ok=True)
