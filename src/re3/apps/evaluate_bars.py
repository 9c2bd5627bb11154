"""Progress of `re3 eval` on standard error: the whole run, and each sequence that is running."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar

from re3.evaluation.runner import Progress

_Running = tuple[str, str, str, int]


class Bars:
    """Bars with frames done and time left; a context manager that takes them away at the end."""

    def __init__(self) -> None:
        self._bars = ProgressBar(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._whole = self._bars.add_task("starting", total=None)
        self._running: dict[_Running, TaskID] = {}
        self._ended = 0

    def __enter__(self) -> Bars:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def advance(self, progress: Progress) -> None:
        """Show where the run is; what `re3.evaluation.runner.run` calls."""
        sequence = progress.sequence
        key = (progress.tracker, sequence.dataset, sequence.name, progress.repeat)
        if progress.ended:
            self._ended += 1
            if key in self._running:
                self._bars.remove_task(self._running.pop(key))
        elif key in self._running:
            self._bars.update(self._running[key], completed=progress.frames)
        else:
            name = f"{sequence.name} · {progress.tracker}"
            if progress.repeat:
                name += f" · {progress.repeat + 1}"
            self._running[key] = self._bars.add_task(
                name, completed=progress.frames, total=len(sequence)
            )
        self._bars.update(
            self._whole,
            description=f"{self._ended} done",
            completed=progress.frames_before + progress.frames,
            total=progress.frames_total,
        )
