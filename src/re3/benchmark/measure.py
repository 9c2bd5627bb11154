"""Times of contenders that take turns, so that a noisy machine treats them alike."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.benchmark.contenders import Contender
from re3.benchmark.footage import Footage
from re3.evaluation.one_pass import Latency, percentiles

Floats = NDArray[np.float64]

WARM_UP = 2
"""Updates of each turn that are not counted: caches and clocks come up."""


@dataclass(frozen=True, eq=False)
class Timing:
    """How long one contender took to follow so many objects.

    Attributes:
        objects: followed at once.
        update, crop, network: seconds of each update and of its parts, `[rounds, frames]`; parts
            are NaN of a contender that does not tell.
    """

    objects: int
    update: Floats
    crop: Floats
    network: Floats

    @property
    def rest(self) -> Floats:
        """What is left of each update: state, decoding of boxes."""
        return self.update - self.crop - self.network

    @property
    def latency(self) -> Latency:
        """Percentiles of an update, each the median over the rounds."""
        return over_rounds(self.update)

    @property
    def fps(self) -> float:
        """Frames a second: one over the median update."""
        return 1.0 / self.latency.p50

    def times_faster_than(self, other: Timing) -> float:
        """Median over the rounds of the ratio of median updates within a round."""
        theirs, ours = np.median(other.update, axis=1), np.median(self.update, axis=1)
        return float(np.median(theirs / ours))


def over_rounds(seconds: Floats) -> Latency:
    """Percentiles of `[rounds, frames]`, each the median over the rounds; NaN where all are."""
    each = [percentiles(one) for one in seconds]
    return Latency(
        *(float(np.median([getattr(p, n) for p in each])) for n in ("p50", "p95", "p99"))
    )


def take_turns(
    contenders: Mapping[str, Contender],
    footage: Footage,
    *,
    objects: int = 1,
    rounds: int = 5,
    frames: int = 40,
    on_turn: Callable[[str], None] = lambda _: None,
) -> dict[str, Timing]:
    """Measure contenders: in each round every one follows the same objects over the same frames.

    The order is turned by one from round to round. All objects are the footage's one, followed
    several times over.

    Args:
        contenders: by name.
        footage: walked to and fro where it has fewer frames than asked for.
        objects, rounds, frames: followed at once, turns of each contender, updates counted a turn.
        on_turn: told of each turn before it begins.

    Raises:
        ValueError: nothing to measure, or a number below 1.
        Whatever a contender raises.
    """
    if not contenders or min(objects, rounds, frames) < 1:
        raise ValueError(
            f"{len(contenders)} contenders, {objects} objects, {rounds} rounds and {frames} "
            "frames; expected 1 or more of each"
        )
    names = list(contenders)
    shape = (rounds, frames)
    found = {
        name: Timing(objects, np.empty(shape), np.empty(shape), np.empty(shape)) for name in names
    }
    for turn in range(rounds):
        shift = turn % len(names)
        for name in names[shift:] + names[:shift]:
            on_turn(name)
            _one_turn(contenders[name], footage, found[name], turn)
    return found


def _one_turn(contender: Contender, footage: Footage, into: Timing, turn: int) -> None:
    contender.start(footage.frames[0], [footage.box_xywh] * into.objects)
    gc.collect()
    frames = into.update.shape[1]
    for step in range(WARM_UP + frames):
        frame = footage.frames[_to_and_fro(step + 1, len(footage.frames))]
        started = time.perf_counter()
        contender.update(frame)
        seconds = time.perf_counter() - started
        if step >= WARM_UP:
            place = turn, step - WARM_UP
            into.update[place] = seconds
            into.crop[place], into.network[place] = contender.time_spent


def _to_and_fro(step: int, count: int) -> int:
    """Index of a frame: 0, 1, ..., count - 1, count - 2, ..., 0, 1, ..."""
    place = step % (2 * count - 2)
    return min(place, 2 * count - 2 - place)
