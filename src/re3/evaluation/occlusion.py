"""How much worse a tracker is while the object is occluded, and with each kind of difficulty.

Re3, sec. IV-E: the success of one pass over all frames beside that over the occluded frames alone,
and the loss from the one to the other, relative to the first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from re3.evaluation.metrics import PRECISION_AT, Scores, precision_curve, success_curve
from re3.evaluation.sequence_result import SequenceResult, grouped


@dataclass(frozen=True)
class FrameFigures:
    """Figures over frames of several tracks thrown together; NaN without a frame.

    Attributes:
        auc: area under the success curve, 21 thresholds.
        precision: share of frames within 20 pixels.
        overlap: mean overlap.
        frames: how many.
    """

    auc: float
    precision: float
    overlap: float
    frames: int


@dataclass(frozen=True)
class OcclusionRow:
    """One tracker on one dataset.

    Attributes:
        dataset, tracker: their names.
        everywhere: over all annotated frames, first ones included.
        occluded: over those of them marked as occluded.
        relative_loss: share of the AUC that is lost, (everywhere - occluded) / everywhere;
            negative for a tracker that is better under occlusion, NaN without occluded frames.
    """

    dataset: str
    tracker: str
    everywhere: FrameFigures
    occluded: FrameFigures
    relative_loss: float


@dataclass(frozen=True)
class AttributeRow:
    """The mean scores of a tracker over the sequences that have an attribute."""

    attribute: str
    tracker: str
    sequences: int
    scores: Scores


def occlusion_table(results: list[SequenceResult]) -> list[OcclusionRow]:
    """A row for each dataset and tracker, over the sequences that say which frames are occluded.

    Datasets without such marks have no row.

    Args:
        results: of one pass; repetitions are thrown together.
    """
    marked = [
        result
        for result in results
        if result.sequence.occluded is not None and not result.track.unscored
    ]
    return [_row(dataset, tracker, group) for (dataset, tracker), group in grouped(marked).items()]


def attribute_means(results: list[SequenceResult]) -> list[AttributeRow]:
    """A row for each attribute and tracker, attributes in order of the alphabet.

    Args:
        results: of one pass, of any number of datasets.
    """
    groups: dict[tuple[str, str], list[SequenceResult]] = {}
    for result in results:
        for attribute in result.sequence.attributes:
            groups.setdefault((attribute, result.tracker), []).append(result)
    return [
        AttributeRow(
            attribute,
            tracker,
            len({(r.sequence.dataset, r.sequence.name) for r in group}),
            Scores.mean([result.scores for result in group]),
        )
        for (attribute, tracker), group in sorted(groups.items(), key=lambda item: item[0][0])
    ]


def _row(dataset: str, tracker: str, group: list[SequenceResult]) -> OcclusionRow:
    overlaps, distances, occluded = [], [], []
    for result in group:
        assert result.sequence.occluded is not None
        errors = result.errors()
        overlaps.append(errors.overlaps)
        distances.append(errors.distances)
        occluded.append(result.sequence.occluded[errors.frames])
    mask = np.concatenate(occluded)
    everywhere = _figures(np.concatenate(overlaps), np.concatenate(distances))
    hidden = _figures(np.concatenate(overlaps)[mask], np.concatenate(distances)[mask])
    loss = (everywhere.auc - hidden.auc) / everywhere.auc if everywhere.auc else float("nan")
    return OcclusionRow(dataset, tracker, everywhere, hidden, loss)


def _figures(overlaps: np.ndarray, distances: np.ndarray) -> FrameFigures:
    if not overlaps.size:
        nan = float("nan")
        return FrameFigures(nan, nan, nan, 0)
    return FrameFigures(
        auc=float(success_curve(overlaps).mean()),
        precision=float(precision_curve(distances)[PRECISION_AT]),
        overlap=float(np.maximum(overlaps, 0.0).mean()),
        frames=len(overlaps),
    )
