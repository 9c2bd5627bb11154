"""Success and precision curves of each tracker, from sequence results."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from re3.evaluation import metrics
from re3.evaluation.plots import Curve
from re3.evaluation.sequence_result import SequenceResult

Floats = NDArray[np.float64]
Pair = tuple[Floats, Floats]
"""Predicted and true boxes of the annotated frames of a track, `[N, 4]` each."""


def by_tracker(results: list[SequenceResult]) -> dict[str, list[SequenceResult]]:
    """The results of each tracker, in order of appearance."""
    groups: dict[str, list[SequenceResult]] = {}
    for result in results:
        groups.setdefault(result.tracker, []).append(result)
    return groups


def mean_curves(
    results: list[SequenceResult],
    thresholds: Floats,
    curve_of: Callable[[Pair], Floats],
    figure_of: Callable[[Floats], float],
) -> list[Curve]:
    """A curve a tracker, the mean over its sequences."""
    made = []
    for tracker, group in by_tracker(results).items():
        mean = np.mean([curve_of(_pair(result)) for result in group], axis=0)
        made.append(Curve(tracker, thresholds, mean, float(figure_of(mean))))
    return made


def pooled_success(results: list[SequenceResult]) -> list[Curve]:
    """A success curve a tracker, over the boxes of all sequences thrown together."""
    return [
        _success_of(tracker, np.concatenate([overlaps_of(result) for result in group]))
        for tracker, group in by_tracker(results).items()
    ]


def occluded_success(results: list[SequenceResult]) -> list[Curve]:
    """The same over occluded frames alone, as in `re3.evaluation.occlusion`.

    Args:
        results: on sequences with marks of occlusion; a tracker without an occluded frame has no
            curve.
    """
    made = []
    for tracker, group in by_tracker(results).items():
        overlaps = np.concatenate([overlaps_of(result)[_occluded(result)] for result in group])
        if overlaps.size:
            made.append(_success_of(tracker, overlaps))
    return made


def _success_of(tracker: str, overlaps: Floats) -> Curve:
    curve = metrics.success_curve(overlaps)
    return Curve(tracker, metrics.OVERLAP_THRESHOLDS, curve, float(curve.mean()))


def _occluded(result: SequenceResult) -> NDArray[np.bool_]:
    sequence = result.sequence
    assert sequence.occluded is not None, "only sequences with marks are asked"
    return sequence.occluded[sequence.annotated]


def _pair(result: SequenceResult) -> Pair:
    return metrics.with_given_frame(result.track.boxes_xywh, result.sequence.boxes_xywh)


def overlaps_of(result: SequenceResult) -> Floats:
    """Overlap `[N]` of the annotated frames of a track."""
    return metrics.overlap(*_pair(result))


def success(pair: Pair) -> Floats:
    """The success curve `[21]` of a track."""
    return metrics.success_curve(metrics.overlap(*pair))


def precision(pair: Pair) -> Floats:
    """The precision curve `[51]` of a track."""
    return metrics.precision_curve(metrics.centre_distance(*pair))


def normalised_precision(pair: Pair) -> Floats:
    """The normalised precision curve `[51]` of a track."""
    return metrics.normalised_precision_curve(metrics.normalised_distance(*pair))
