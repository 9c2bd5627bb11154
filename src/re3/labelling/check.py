"""How accurate labels are, measured on clips with annotation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from collections.abc import Sequence as Several
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence
from re3.evaluation.metrics import overlap
from re3.labelling.agreement import Agreement, Pair, follow, kept_boxes, stretches
from re3.labelling.config import LabelConfig
from re3.labelling.shots import ShotReader

Floats = NDArray[np.float64]

THRESHOLDS = (0.0, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Agreements for which figures are printed; 0 keeps whatever all three runs reached."""


# Without eq=False the generated __eq__ would compare arrays and fail on their truth value.
@dataclass(frozen=True, eq=False)
class CheckedStretch:
    """One start box of the annotation, followed.

    Attributes:
        agreement: as `follow` gives it.
        truth_xywh: `[T, 4]` in pixels of the scaled frames, NaN where the object is absent.
        start: index of the frame whose box was given.
    """

    agreement: Agreement
    truth_xywh: Floats
    start: int


@dataclass(frozen=True)
class Accuracy:
    """How accurate the boxes are that a threshold keeps; the start frames do not count.

    Attributes:
        threshold: least agreement.
        tracks: stretches kept.
        frames: of these stretches, interpolated ones as well.
        kept: these as a share of all frames, 0..1.
        above_half, above_seven_tenths: share of the kept frames whose box has an overlap (IoU)
            with the annotation of .5 or more, and of .7 or more.
        mean_overlap: over the kept frames, 0..1.
    """

    threshold: float
    tracks: int
    frames: int
    kept: float
    above_half: float
    above_seven_tenths: float
    mean_overlap: float


def follow_annotated(
    sequences: Iterable[Sequence],
    pair: Pair,
    config: LabelConfig,
    on_progress: Callable[[int], None] = lambda done: None,
) -> list[CheckedStretch]:
    """Follow the object of each sequence from its annotated box in the middle of its first shot.

    Args:
        sequences: annotated clips.
        pair, config: as for labelling; frame rate, size and longest track are those of `config`.
        on_progress: called with the number of sequences done.

    Raises:
        ValueError: a clip cannot be read, or ends before its annotation does.
    """
    checked = []
    for done, sequence in enumerate(sequences, start=1):
        reader = ShotReader(sequence.source, config, sequence.start_frame)
        shot = next(reader.shots(), None)
        if shot is not None:
            rows = shot.indices - sequence.start_frame
            inside = rows < len(sequence)
            truth = sequence.boxes_xywh[rows[inside]] * shot.scale
            frames = shot.frames[: len(truth)]
            annotated = np.flatnonzero(~np.isnan(truth[:, 0]))
            if len(annotated):
                start = int(annotated[len(annotated) // 2])
                agreement = follow(pair, frames, start, truth[start])
                checked.append(CheckedStretch(agreement, truth, start))
        on_progress(done)
    return checked


def accuracy(checked: Several[CheckedStretch], threshold: float, config: LabelConfig) -> Accuracy:
    """The accuracy of what a threshold keeps."""
    overlaps: list[Floats] = []
    tracks = total = 0
    for stretch in checked:
        keep = np.zeros(len(stretch.truth_xywh), dtype=bool)
        boxes = np.zeros((len(keep), 4))
        # Without a threshold a frame must still have been reached by all runs.
        reached = ~np.isnan(stretch.agreement.boxes_xywh[:, 0])
        overlapping = np.where(reached, stretch.agreement.overlaps, -1.0)
        found = Agreement(stretch.agreement.boxes_xywh, overlapping)
        for part in stretches(overlapping, threshold, config.shortest, config.gap):
            keep[part] = True
            boxes[part] = kept_boxes(found, part, threshold)
            tracks += 1
        keep[stretch.start] = False
        total += len(keep) - 1
        overlaps.append(overlap(boxes[keep], stretch.truth_xywh[keep]))
    every = np.concatenate(overlaps) if overlaps else np.zeros(0)
    kept = len(every)
    return Accuracy(
        threshold,
        tracks,
        kept,
        kept / total if total else 0.0,
        float((every >= 0.5).mean()) if kept else float("nan"),
        float((every >= 0.7).mean()) if kept else float("nan"),
        float(every.mean()) if kept else float("nan"),
    )
