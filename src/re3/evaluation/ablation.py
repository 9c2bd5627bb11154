"""The ablation study's figures: accuracy, drops, robustness and their average (Re3, Table I).

The paper defines the average as the mean of accuracy and robustness; how a dropped track goes on
it does not say. That follows the evaluation script its authors published with their code
(github.com/danielgordon10/re3-tensorflow, training/test_net.py):

* a track is dropped in a frame where the box and the truth do not overlap at all;
* the five frames after it are passed over, and the tracker is started with the truth in the sixth;
* the ten frames from a restart on, the restart included, are not counted and cannot be a drop;
* the first frame of a track counts, with overlap 1; the frame of a drop counts, with overlap 0.

Robustness is e^(-30 · drops / frames). Frames are all annotated ones, also those passed over: with
them the formula gives 10 of the 11 robustness figures that Table I has for Imagenet Video, of
273,505 boxes (row I is off by one in the last digit). All frames of all sequences are thrown
together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence
from re3.evaluation.metrics import overlap
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.supervised import Step, SupervisedConfig, SupervisedTrack

ABLATION = SupervisedConfig(restart_after=6, grace=10)
SENSITIVITY = 30.0


@dataclass(frozen=True)
class Ablation:
    """A row of Table I.

    Attributes:
        accuracy: mean overlap over the counted frames, 0..1; NaN without any.
        drops: how often the track was lost.
        robustness: e^(-30 · drops / frames), 0..1.
        average: the mean of accuracy and robustness.
        frames: annotated frames of all sequences.
    """

    accuracy: float
    drops: int
    robustness: float
    average: float
    frames: int


def ablation(results: list[SequenceResult]) -> Ablation:
    """The figures of one tracker over its sequences, run with `ABLATION`.

    A tracker that crashed has dropped the track there, and the frames after it count with overlap
    0. Sequences that could not be run for no fault of the tracker are left out.

    Raises:
        ValueError: a result of another protocol, without failures and restarts.
    """
    overlaps, drops, frames = [], 0, 0
    for result in results:
        if result.supervised is None:
            raise ValueError(
                f"the result of {result.tracker} on {result.sequence.name!r} is of one pass; "
                "expected one with restarts, of the ablation protocol"
            )
        if result.supervised.unscored:
            continue
        overlaps.append(counted_overlaps(result.supervised, result.sequence))
        drops += result.supervised.drops
        frames += int(result.sequence.annotated.sum())
    values = np.concatenate(overlaps) if overlaps else np.empty(0)
    accuracy = float(values.mean()) if values.size else math.nan
    robust = robustness(drops, frames)
    return Ablation(accuracy, drops, robust, (accuracy + robust) / 2, frames)


def robustness(drops: int, frames: int) -> float:
    """e^(-30 · drops / frames); NaN without frames."""
    return math.exp(-SENSITIVITY * drops / frames) if frames else math.nan


def counted_overlaps(track: SupervisedTrack, sequence: Sequence) -> NDArray[np.float64]:
    """Overlap `[N]` of each counted frame; see the head of this module."""
    steps = track.steps
    counted = (steps != Step.SKIPPED) & sequence.annotated
    for restart in np.flatnonzero(steps == Step.STARTED)[1:]:
        counted[restart : restart + ABLATION.grace] = False
    if track.failure is not None:
        failed = np.flatnonzero(steps == Step.FAILED)
        crash = int(failed[-1]) if failed.size else 0
        counted[crash:] = sequence.annotated[crash:]
    return overlap(track.boxes_xywh[counted], sequence.boxes_xywh[counted])
