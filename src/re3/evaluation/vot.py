"""The measures of the VOT challenges' supervised experiment: accuracy, robustness, EAO.

Kristan et al.: A novel performance evaluation methodology for single-target trackers, TPAMI 2016;
The Visual Object Tracking VOT2015 challenge results, ICCVW 2015, for the expected average overlap.
What is computed is what vot-toolkit 0.9.0 computes in `vot.analysis.supervised`, from the same
trajectories to the same figures; its conventions, which the papers leave open:

* Overlap is counted in whole pixels, see `re3.evaluation.vot_overlap`. Where the truth is a polygon
  it is that of the box with the polygon.
* Accuracy of a run is the mean overlap over the frames the tracker followed, without the frame of
  a start and the `burn_in - 1` after it; 0 where no frame is left. Accuracy of a sequence is the
  mean over its runs, and that of a data set the mean over sequences weighted by their number of
  *frames*, not of the frames that counted.
* Robustness is the number of failures in a sequence, mean over its runs, then over sequences with
  the same weights. Less is better.
* The curve of expected average overlap is in `re3.evaluation.vot_fragments`. EAO is its mean from
  `low` to `high`, both included, or as far as the curve goes. Where it ends before `low` there is
  no EAO (NaN).

The toolkit knows no frame without truth: it would call each a failure. Here such frames count
neither for accuracy nor in a fragment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence as List
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from re3.evaluation.supervised import Step, SupervisedTrack
from re3.evaluation.vot_fragments import expected_overlap_curve
from re3.evaluation.vot_overlap import Polygons, pixel_overlaps

__all__ = [
    "STACKS",
    "VotRuns",
    "VotScores",
    "VotStack",
    "expected_overlap_curve",
    "find_stack",
    "pixel_overlaps",
    "score_vot",
]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class VotStack:
    """A VOT challenge as the toolkit describes it: its experiment `baseline` and the analyses.

    Attributes:
        name: the challenge, e.g. `vot2016`.
        toolkit_name: the toolkit's name of its description, e.g. `vot2016/rgb`.
        interval: first and last length in frames, both included, over which EAO averages; None
            where the challenge has no EAO.
        repetitions: runs of each sequence; the toolkit stops at three that are equal.
        restart_after: frames from a failure to the next start.
        burn_in: frames from a start on that do not count for accuracy, the start among them.
        sensitivity: length in frames at which the AR plot asks for the chance of survival.

    Raises:
        ValueError: a number is out of its range.
    """

    name: str
    toolkit_name: str
    interval: tuple[int, int] | None
    repetitions: int = 15
    restart_after: int = 5
    burn_in: int = 10
    sensitivity: float = 30.0

    def __post_init__(self) -> None:
        if self.interval is not None and not 0 <= self.interval[0] <= self.interval[1]:
            raise ValueError(f"interval is {self.interval}; expected two lengths, 0 <= low <= high")
        if self.repetitions < 1 or self.restart_after < 1 or self.burn_in < 0:
            raise ValueError(
                f"repetitions {self.repetitions}, restart_after {self.restart_after}, burn_in "
                f"{self.burn_in}; expected at least 1, 1 and 0"
            )
        if not self.sensitivity >= 1:
            raise ValueError(f"sensitivity is {self.sensitivity}; expected 1 frame or more")


STACKS = {
    stack.name: stack
    for stack in (
        VotStack("vot2013", "vot2013", None),
        VotStack("vot2014", "vot2014", None),
        VotStack("vot2015", "vot2015/rgb", (108, 371)),
        VotStack("vot2016", "vot2016/rgb", (108, 371)),
        VotStack("vot2017", "vot2017", (100, 356)),
        VotStack("vot2018", "vot2018/shortterm", (100, 356)),
    )
}
"""The challenges with a supervised experiment, with the figures of vot-toolkit 0.9.0."""


def find_stack(name: str, interval: str | None = None, repetitions: int | None = None) -> VotStack:
    """A challenge by name, with settings of one's own in place of its own.

    Args:
        name: one of `STACKS`.
        interval: `LOW,HIGH`, the shortest and the longest length that EAO averages over.
        repetitions: runs of each sequence.

    Raises:
        ValueError: no such challenge, or a setting that cannot be.
    """
    if name not in STACKS:
        raise ValueError(f"no VOT challenge {name!r}; expected one of {', '.join(STACKS)}")
    stack = STACKS[name]
    if repetitions is not None:
        stack = replace(stack, repetitions=repetitions)
    if interval is not None:
        try:
            low, high = (int(part) for part in interval.split(","))
        except ValueError:
            raise ValueError(
                f"--interval {interval!r} is not LOW,HIGH; expected two whole numbers"
            ) from None
        stack = replace(stack, interval=(low, high))
    return stack


@dataclass(frozen=True, eq=False)
class VotRuns:
    """All runs of one tracker on one sequence.

    Attributes:
        name: of the sequence.
        truth_xywh: `[T, 4]` in pixels, NaN where there is no truth.
        size: width and height of the frames in pixels; what lies outside does not count.
        runs: one or more, each of T frames.
        polygons: of each frame the truth's polygon `[P, 2]`, None where the truth is the box; None
            where all are boxes.
        occluded: `[T]`, the frames marked as occluded; None where nothing is marked.

    Raises:
        ValueError: no run, one of another length, or one whose frames could not be read.
    """

    name: str
    truth_xywh: Floats
    size: tuple[int, int]
    runs: List[SupervisedTrack]
    polygons: Polygons | None = None
    occluded: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        if not self.runs:
            raise ValueError(f"sequence {self.name!r} has no run; expected one or more")
        for run in self.runs:
            if len(run.steps) != len(self.truth_xywh):
                raise ValueError(
                    f"sequence {self.name!r} has {len(self.truth_xywh)} frames, but a run has "
                    f"{len(run.steps)}; expected as many"
                )
            if run.unscored:
                raise ValueError(
                    f"sequence {self.name!r} cannot be scored, its frames could not be read: "
                    f"{run.failure}"
                )

    @cached_property
    def overlaps(self) -> list[Floats]:
        """Of each run `[T]`: NaN without truth, 0 where it was started, failed or skipped."""
        return [self._overlaps_of(run) for run in self.runs]

    def _overlaps_of(self, run: SupervisedTrack) -> Floats:
        followed = (run.steps == Step.FOLLOWED)[:, None]
        boxes = np.where(followed, run.boxes_xywh, np.nan)
        overlaps = pixel_overlaps(boxes, self.truth_xywh, self.size, self.polygons)
        overlaps[np.isnan(self.truth_xywh).any(axis=1)] = np.nan
        return overlaps


@dataclass(frozen=True, eq=False)
class VotScores:
    """The figures of a tracker on a set of sequences.

    Attributes:
        accuracy: mean overlap, 0..1, more is better.
        robustness: failures a sequence, less is better.
        reliability: chance of following for `sensitivity` frames, 0..1: the AR plot's other axis.
        failures: failures over all sequences.
        eao: expected average overlap, 0..1; NaN without interval or where the curve is too short.
        curve: `[L]`, expected average overlap over sequences of t frames.
        eao_occluded: expected average overlap on occluded frames; NaN as `eao`, and where no frame
            is marked as occluded.
    """

    accuracy: float
    robustness: float
    reliability: float
    failures: float
    eao: float
    curve: Floats
    eao_occluded: float = float("nan")


def score_vot(sequences: List[VotRuns], stack: VotStack) -> VotScores:
    """All measures of one tracker.

    Args:
        sequences: its runs on each; one or more.
        stack: of the challenge.

    Raises:
        ValueError: no sequence.
    """
    if not sequences:
        raise ValueError("no sequences; expected the runs on one or more")
    frames = np.array([len(sequence.truth_xywh) for sequence in sequences], dtype=np.float64)
    accuracies, failures = np.array([_accuracy_and_failures(s, stack) for s in sequences]).T
    robustness = float(np.average(failures, weights=frames))
    curve = expected_overlap_curve(sequences)
    longest = len(curve) if stack.interval is None else stack.interval[1]
    occluded = expected_overlap_curve(sequences, occluded_up_to=longest)
    return VotScores(
        accuracy=float(np.average(accuracies, weights=frames)),
        robustness=robustness,
        reliability=math.exp(-robustness / frames.mean() * stack.sensitivity),
        failures=float(failures.sum()),
        eao=_mean_over(curve, stack),
        curve=curve,
        eao_occluded=_mean_over(occluded, stack),
    )


def _mean_over(curve: Floats, stack: VotStack) -> float:
    """The mean of a curve over the stack's interval; NaN where either is missing."""
    if stack.interval is None or len(curve) <= stack.interval[0]:
        return math.nan
    return float(curve[stack.interval[0] : stack.interval[1] + 1].mean())


def _accuracy_and_failures(sequence: VotRuns, stack: VotStack) -> tuple[float, float]:
    """Both of one sequence, means over its runs."""
    accuracies, failures = [], []
    for run, overlaps in zip(sequence.runs, sequence.overlaps, strict=True):
        counts = run.steps == Step.FOLLOWED
        for start in np.flatnonzero(run.steps == Step.STARTED):
            counts[start : start + stack.burn_in] = False
        counts &= ~np.isnan(overlaps)
        accuracies.append(overlaps[counts].mean() if counts.any() else 0.0)
        failures.append(run.drops)
    return float(np.mean(accuracies)), float(np.mean(failures))
