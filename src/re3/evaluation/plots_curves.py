"""Success and precision curves of each tracker, from sequence results."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from re3.evaluation import metrics
from re3.evaluation.metrics import FrameErrors
from re3.evaluation.plots import Curve
from re3.evaluation.sequence_result import SequenceResult

Floats = NDArray[np.float64]


def by_tracker(results: list[SequenceResult]) -> dict[str, list[SequenceResult]]:
    """The results of each tracker, in order of appearance."""
    groups: dict[str, list[SequenceResult]] = {}
    for result in results:
        groups.setdefault(result.tracker, []).append(result)
    return groups


def mean_curves(
    results: list[SequenceResult],
    thresholds: Floats,
    curve_of: Callable[[FrameErrors], Floats],
    figure_of: Callable[[Floats], float],
) -> list[Curve]:
    """A curve a tracker, the mean over its sequences."""
    made = []
    for tracker, group in by_tracker(results).items():
        mean = np.mean([curve_of(result.errors()) for result in group], axis=0)
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
    assert result.sequence.occluded is not None, "only sequences with marks are asked"
    return result.sequence.occluded[result.errors().frames]


def overlaps_of(result: SequenceResult) -> Floats:
    """Overlap `[N]` of the frames of a track that count."""
    return result.errors().overlaps


def success(errors: FrameErrors) -> Floats:
    """The success curve `[21]` of a track."""
    return metrics.success_curve(errors.overlaps)


def precision(errors: FrameErrors) -> Floats:
    """The precision curve `[51]` of a track."""
    return metrics.precision_curve(errors.distances)


def normalised_precision(errors: FrameErrors) -> Floats:
    """The normalised precision curve `[51]` of a track."""
    return metrics.normalised_precision_curve(errors.normalised)
