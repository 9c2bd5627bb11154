"""Who takes an object back that was hidden (`re3.data.hiding`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from re3.data.hiding import AFTER, HiddenSequence
from re3.evaluation.metrics import overlap
from re3.evaluation.sequence_result import SequenceResult

ALIVE = 0.2
"""A track whose box overlaps the object by this much has it."""


@dataclass(frozen=True)
class Reappearance:
    """What became of the objects that were hidden.

    Attributes:
        alive: share of tracks that have the object `AFTER` frames after it is back.
        alive_before: share that had it in the frame before it was hidden, which bounds the other.
        overlap_after: mean overlap from `AFTER` frames after it is back to the end.
    """

    alive: float
    alive_before: float
    overlap_after: float


def reappearance(results: list[SequenceResult]) -> Reappearance:
    """Over results on sequences that `hide` made; others say nothing."""
    alive, before, after = [], [], []
    for result in results:
        sequence = result.sequence
        if not isinstance(sequence, HiddenSequence) or result.track.unscored:
            continue
        # A tracker that has stopped has lost the object: NaN boxes count as no overlap.
        overlaps = np.nan_to_num(overlap(result.track.boxes_xywh, sequence.boxes_xywh))
        back = sequence.hidden_to + AFTER
        alive.append(overlaps[back] >= ALIVE)
        before.append(overlaps[sequence.hidden_from - 1] >= ALIVE)
        after.append(overlaps[back:][sequence.annotated[back:]].mean())
    if not alive:
        return Reappearance(float("nan"), float("nan"), float("nan"))
    return Reappearance(*(float(np.mean(values)) for values in (alive, before, after)))
