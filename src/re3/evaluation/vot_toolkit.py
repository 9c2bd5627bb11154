"""The official VOT toolkit, run in a process of its own.

`python -m re3.evaluation.vot_toolkit ARGUMENTS` is the toolkit's command `vot ARGUMENTS` with two
changes, made in that process alone:

* The supervised experiment works. In vot-toolkit 0.9.0 it hands the TraX runtime one object where
  the runtime wants a list of objects, and takes the answer, a list, for one object, so that every
  run ends with "Tracker does not support multiple objects". `repair` puts the list around the
  object and takes it off again; the experiment and the analyses are untouched.
* It does not ask GitHub whether there is a newer toolkit, which takes seconds without a network.

The toolkit is licensed under the GPL 3; nothing of it is part of re3, which starts it as a program.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

TOOLKIT = "vot-toolkit==0.9.0"
HOW_TO_INSTALL = f"pip install 're3[vot]' && pip install --no-deps {TOOLKIT}"

_TOLD_LINES = 8


class ToolkitError(RuntimeError):
    """The toolkit is missing, or ended with an error; the message has its last lines."""


def check_toolkit() -> str:
    """The version of the toolkit that is installed.

    Raises:
        ToolkitError: there is none; says how to install it.
    """
    # TraX in front: without it the toolkit starts, and fails at the first tracker.
    for module in ("trax", "vot"):
        if importlib.util.find_spec(module) is None:
            raise ToolkitError(
                f"the VOT toolkit is not installed (no module {module}); install it with: "
                f"{HOW_TO_INSTALL}"
            )
    return importlib.metadata.version("vot-toolkit")


def run_toolkit(*arguments: str, workspace: Path, log: Path) -> None:
    """Run a command of the toolkit on a workspace.

    Trajectories are written as text, and analyses are computed anew: the toolkit's cache knows
    them by the names of trackers and sequences alone, and would give figures of earlier runs.

    Args:
        arguments: as for `vot`, without the workspace.
        workspace: its folder.
        log: file to add all that the toolkit prints to; its folder must exist.

    Raises:
        ToolkitError: it ended with an error, or said that it met one; it exits with 0 after some.
        OSError: the log cannot be written.
    """
    command = [sys.executable, "-m", __name__, *arguments]
    environment = {
        **os.environ,
        # The toolkit starts trackers in a folder of their own, where relative paths lead nowhere.
        "PYTHONPATH": absolute_python_path(),
        "VOT_RESULTS_BINARY": "false",
        "VOT_PERSISTENT_CACHE": "false",
    }
    with log.open("a", encoding="utf-8") as file:
        start = file.tell()
        file.write(f"$ vot {' '.join(arguments)}\n")
        file.flush()
        done = subprocess.run(
            [*command, "--workspace", str(workspace.absolute())],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=environment,
            cwd=workspace,
            check=False,
        )
    printed = log.read_text(encoding="utf-8", errors="replace")[start:]
    complaints = ("encountered an error", "interrupted by tracker error", "Unable to", "Error dur")
    if done.returncode != 0 or any(words in printed for words in complaints):
        lines = [line.strip() for line in printed.splitlines() if line.strip()]
        raise ToolkitError(
            f"`vot {' '.join(arguments)}` failed (exit code {done.returncode}); the last lines of "
            f"{log}: " + " | ".join(lines[-_TOLD_LINES:])
        )


def repair() -> None:
    """Let the TraX runtime take and give one object where the caller does; see the module's head.

    Callers that hand over lists, as a repaired toolkit would, find it unchanged.
    """
    status_type = importlib.import_module("vot.tracker").ObjectStatus
    runtime_type = importlib.import_module("vot.tracker.trax").TraxTrackerRuntime
    initialize, update = runtime_type.initialize, runtime_type.update

    def initialize_one_or_many(runtime: Any, frame: Any, new: Any = None, *rest: Any) -> Any:
        runtime.re3_one = isinstance(new, status_type)
        given, seconds = initialize(runtime, frame, [new] if runtime.re3_one else new, *rest)
        return _unpacked(runtime, given), seconds

    def update_one_or_many(runtime: Any, frame: Any, new: Any = None, *rest: Any) -> Any:
        if new is None and getattr(runtime, "re3_one", False):
            new = []
        given, seconds = update(runtime, frame, new, *rest)
        return _unpacked(runtime, given), seconds

    runtime_type.initialize, runtime_type.update = initialize_one_or_many, update_one_or_many


def _unpacked(runtime: Any, given: Any) -> Any:
    one = getattr(runtime, "re3_one", False)
    return given[0] if one and isinstance(given, list) else given


def absolute_python_path() -> str:
    """This process's PYTHONPATH with every part absolute; empty without one."""
    parts = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return os.pathsep.join(str(Path(part).absolute()) for part in parts if part)


def main() -> None:
    """The toolkit's command line, repaired."""
    repair()
    command_line: Any = importlib.import_module("vot.utilities.cli")
    command_line.check_updates = lambda: (False, None)
    command_line.main()


if __name__ == "__main__":
    main()
