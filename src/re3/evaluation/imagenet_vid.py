"""Imagenet Video: one success curve over every box of every track (Re3, sec. IV-B).

Each track is started once, at its first annotated frame, and never again. Unlike the one-pass
figures of `re3.evaluation.metrics`, which are means over sequences, all boxes are thrown together,
so that a long track weighs more than a short one.

The paper calls this equivalent to OTB's one-pass evaluation and says nothing of the first frame.
As there, it counts with an overlap of 1 in `auc`; `auc_after_first` leaves it out, which matters
with tracks of a few frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.evaluation.metrics import overlap, success_curve, with_given_frame
from re3.evaluation.sequence_result import SequenceResult


@dataclass(frozen=True, eq=False)
class PooledSuccess:
    """Success over the boxes of many tracks.

    Attributes:
        curve: `[21]`, share of boxes whose overlap is above each of
            `re3.evaluation.metrics.OVERLAP_THRESHOLDS`, first frames included.
        auc: its mean; NaN without a box.
        auc_after_first: the same with the first frame of each track left out.
        tracks: how many were counted.
        boxes: how many boxes were compared, first frames included.
    """

    curve: NDArray[np.float64]
    auc: float
    auc_after_first: float
    tracks: int
    boxes: int


def pooled_success(results: list[SequenceResult]) -> PooledSuccess:
    """The curve over all annotated frames of one tracker's one-pass results.

    Frames for which the tracker has no box, after a failure for instance, have overlap 0. Tracks
    that could not be run for no fault of the tracker are left out.
    """
    tracks = []
    for result in results:
        if not result.track.unscored:
            truth = result.sequence.boxes_xywh
            tracks.append(overlap(*with_given_frame(result.track.boxes_xywh, truth)))
    curve = _curve(tracks)
    return PooledSuccess(
        curve=curve,
        auc=float(curve.mean()),
        auc_after_first=float(_curve([overlaps[1:] for overlaps in tracks]).mean()),
        tracks=len(tracks),
        boxes=sum(map(len, tracks)),
    )


def _curve(tracks: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    overlaps = np.concatenate(tracks) if tracks else np.empty(0)
    return success_curve(overlaps) if overlaps.size else np.full(21, np.nan)
