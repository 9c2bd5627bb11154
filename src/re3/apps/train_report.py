"""What `re3 train` shows while it runs."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from re3.training.records import Progress as TrainingProgress
    from re3.training.throughput import Throughput

LOG_SECONDS = 30.0


class Report:
    """A progress bar on a terminal, a line now and then elsewhere."""

    def __init__(self, console: Console, iterations: int | None = None) -> None:
        self.console = console
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self.task = self.bar.add_task("training", total=iterations)
        self.logged = 0.0

    def __enter__(self) -> Self:
        self.bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.stop()

    def phase(self, ended: Throughput) -> None:
        """Say how fast a phase went."""
        self.console.print(str(ended), markup=False)

    def __call__(self, progress: TrainingProgress) -> None:
        text = (
            f"unroll {progress.unroll}, loss {progress.loss:.3f}, overlap {progress.overlap:.3f}, "
            f"{progress.pairs_per_second:.0f} pairs/s"
        )
        self.bar.update(
            self.task,
            completed=progress.iteration,
            total=progress.iterations,
            description=text,
        )
        if not self.console.is_terminal and time.monotonic() - self.logged > LOG_SECONDS:
            self.logged = time.monotonic()
            self.console.print(f"{progress.iteration}/{progress.iterations} {text}")
