"""How fast a phase of training went, and where its time was spent."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

from re3.training.recipe import Phase


@dataclass
class Stopwatch:
    """Adds up the seconds that named parts of the work take; parts do not overlap.

    Attributes:
        seconds: by part.
    """

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def time(self, part: str) -> Iterator[None]:
        """Count the time inside as this part's."""
        started = time.monotonic()
        yield
        self.seconds[part] = self.seconds.get(part, 0.0) + time.monotonic() - started


@dataclass(frozen=True)
class Throughput:
    """What a phase, or the part of it since the run was started, came to.

    Validation and checkpoints are not in it.

    Attributes:
        phase: index into the recipe's phases.
        unroll, batch: of the phase.
        iterations: that were timed.
        pairs_per_second: pairs of crops learnt from in a second.
        seconds: of an iteration, the mean, by part: `clips` waited for the clips to be drawn,
            `crops` cut, `features` of the trunk, `walk` of the head without gradients, `learn` with
            them, the optimiser's steps included.
        shares: of the time, by part.
    """

    phase: int
    unroll: int
    batch: int
    iterations: int
    pairs_per_second: float
    seconds: dict[str, float]
    shares: dict[str, float]

    def figures(self) -> dict[str, Any]:
        """All of it, rounded, for the log."""
        return {
            **asdict(self),
            "pairs_per_second": round(self.pairs_per_second, 2),
            "seconds": {name: round(value, 4) for name, value in self.seconds.items()},
            "shares": {name: round(value, 4) for name, value in self.shares.items()},
        }

    def __str__(self) -> str:
        shares = ", ".join(f"{name} {share:.1%}" for name, share in self.shares.items())
        return (
            f"phase {self.phase + 1} (unroll {self.unroll}, batch {self.batch}): "
            f"{self.pairs_per_second:.1f} pairs/s over {self.iterations} iterations; {shares}"
        )


class Meter:
    """Collects the iterations of a phase."""

    def __init__(self) -> None:
        self._iterations = 0
        self._seconds: dict[str, float] = {}

    def add(self, seconds: dict[str, float]) -> None:
        """Take note of an iteration, by the seconds of its parts."""
        self._iterations += 1
        for part, value in seconds.items():
            self._seconds[part] = self._seconds.get(part, 0.0) + value

    def end(self, index: int, phase: Phase) -> Throughput:
        """What the phase came to; the next one is counted from here on."""
        whole = max(sum(self._seconds.values()), 1e-9)
        count = max(self._iterations, 1)
        ended = Throughput(
            phase=index,
            unroll=phase.unroll,
            batch=phase.batch,
            iterations=self._iterations,
            pairs_per_second=self._iterations * phase.batch * (phase.unroll + 1) / whole,
            seconds={part: value / count for part, value in self._seconds.items()},
            shares={part: value / whole for part, value in self._seconds.items()},
        )
        self._iterations, self._seconds = 0, {}
        return ended
