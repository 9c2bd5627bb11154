"""The sequences that a command works on: read from folders, and chosen by name."""

from __future__ import annotations

from pathlib import Path

from re3.data.formats import FORMATS, read_dataset
from re3.data.sequence import Sequence
from re3.data.still_formats import STILL_FORMATS

FORMAT_HELP = (
    f"Format of the data: {', '.join(known.name for known in FORMATS)}. Default: what the folder "
    "looks like."
)
STILL_FORMAT_HELP = (
    f"Format of the stills: {', '.join(known.name for known in STILL_FORMATS)}. Default: what the "
    "folder looks like."
)


def read_sequences(folders: list[Path], format_name: str | None = None) -> list[Sequence]:
    """The sequences of some datasets, in order.

    Raises:
        ValueError, OSError: no folder, or one that cannot be read; see `read_dataset`.
    """
    if not folders:
        raise ValueError("no data given; expected folders with annotated clips, see --help")
    return [sequence for folder in folders for sequence in read_dataset(folder, format_name)]


def choose_sequences(sequences: list[Sequence], names: str | None) -> list[Sequence]:
    """The sequences named, in their own order; all without names.

    Args:
        sequences: to choose from.
        names: separated by commas; a clip's name stands for all its tracks.

    Raises:
        ValueError: a name is that of no sequence, or there is none in `names`.
    """
    if names is None:
        return sequences
    wanted = {name.strip() for name in names.split(",") if name.strip()}
    chosen = [s for s in sequences if not wanted.isdisjoint(_names_of(s))]
    known = {name for sequence in sequences for name in _names_of(sequence)}
    if unknown := sorted(wanted - known):
        raise ValueError(
            f"no sequence is called {', '.join(unknown)}; there are "
            + ", ".join(sequence.name for sequence in sequences)
        )
    if not chosen:
        raise ValueError(f"--sequences {names!r} names none; expected names separated by commas")
    return chosen


def _names_of(sequence: Sequence) -> set[str]:
    return {sequence.name, sequence.name.partition("/")[0]}
