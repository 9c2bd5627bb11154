"""One object followed by two trackers, forward and backward, and where their boxes agree."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence as Several
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.evaluation.metrics import overlap
from re3.evaluation.peers import SequenceTracker

Floats = NDArray[np.float64]

APART = 0.3
"""Overlap (IoU) below which two boxes do not show the same object."""
PATIENCE = 5
"""Frames in a row with boxes apart after which following stops."""
SAME_EXTENT = 0.45
"""Least overlap of a region with the box that the teacher finds in the very same frame."""
CONFIRMED = 0.7
"""Least overlap of that box with the second tracker's."""


@dataclass(frozen=True)
class Pair:
    """The two trackers.

    Attributes:
        teacher: followed in both directions.
        second: beside it, from the start only.
    """

    teacher: SequenceTracker
    second: SequenceTracker


# Without eq=False the generated __eq__ would compare arrays and fail on their truth value.
@dataclass(frozen=True, eq=False)
class Agreement:
    """Boxes of one object and how well the trackers agree on them.

    Attributes:
        boxes_xywh: `[T, 4]`, mean of the three boxes; NaN in frames that not all runs reached.
        overlaps: `[T]`, smallest overlap (IoU) of two of the three boxes, 0 in those frames.
    """

    boxes_xywh: Floats
    overlaps: Floats


def follow(
    pair: Pair, frames: Several[NDArray[np.uint8]], start: int, box_xywh: Floats
) -> Agreement:
    """Follow an object through frames without a cut.

    Both trackers run from the start to the end and from the start to the beginning, until their
    boxes are apart. The teacher then runs back over these frames from the last box on which both
    agreed: a forward run that has gone over to something else does not come back to the start.

    Args:
        pair: the trackers.
        frames: uint8 `[H, W, 3]` BGR, T of them, of one size.
        start: index of the frame with the box.
        box_xywh: `[4]` of the object there.
    """
    runs: dict[int, tuple[Floats, Floats]] = {}
    for order in (range(start, -1, -1), range(start, len(frames))):
        runs |= _side_by_side(pair, frames, order, box_xywh)
    boxes, overlaps = np.full((len(frames), 4), np.nan), np.zeros(len(frames))
    agreed = [index for index, both in runs.items() if _iou(*both) >= APART]
    first, last = min(agreed), max(agreed)
    back = _back(pair.teacher, frames, range(last, first - 1, -1), runs)
    for index in sorted(back):
        teacher, second = runs[index]
        boxes[index] = (teacher + second + back[index]) / 3
        overlaps[index] = min(
            _iou(teacher, second), _iou(teacher, back[index]), _iou(second, back[index])
        )
    return Agreement(boxes, overlaps)


def settled(pair: Pair, frame: NDArray[np.uint8], box_xywh: Floats) -> Floats | None:
    """The box `[4]` of the object that a region shows, None where it shows none.

    The teacher is started on the region and asked for its box in the same frame, then on that.
    A region of background or of a part has no extent of its own: the boxes do not settle.

    Args:
        pair: the trackers; both must find the box.
        frame: uint8 `[H, W, 3]` BGR.
        box_xywh: `[4]` of the region.
    """
    box = box_xywh
    for _ in range(2):
        pair.teacher.init(frame, box)
        box = _update(pair.teacher, frame)
        if not usable(box):
            return None
    if _iou(box, box_xywh) < SAME_EXTENT:
        return None
    pair.second.init(frame, box)
    return box if _iou(_update(pair.second, frame), box) >= CONFIRMED else None


def stretches(overlaps: Floats, threshold: float, shortest: int, gap: int) -> list[slice]:
    """The stretches of frames on which the trackers agree.

    Args:
        overlaps: `[T]`, as `Agreement` has them.
        threshold: least overlap in the first and the last frame of a stretch, 0..1.
        shortest: frames of a stretch at least.
        gap: frames in a row below the threshold that a stretch may contain.
    """
    found: list[slice] = []
    for index in np.flatnonzero(overlaps >= threshold).tolist():
        if found and index - found[-1].stop <= gap:
            found[-1] = slice(found[-1].start, index + 1)
        else:
            found.append(slice(index, index + 1))
    return [stretch for stretch in found if stretch.stop - stretch.start >= shortest]


def kept_boxes(found: Agreement, stretch: slice, threshold: float) -> Floats:
    """The boxes `[T, 4]` of a stretch; where the trackers do not agree, interpolated.

    Training reads a frame without a box as one without the object, so that a gap must not stay.

    Args:
        found: boxes of the whole shot.
        stretch: one of `stretches`, whose first and last frame have agreement.
        threshold: least overlap of a frame with agreement.
    """
    boxes = found.boxes_xywh[stretch]
    rows = np.arange(len(boxes))
    agreed = found.overlaps[stretch] >= threshold
    return np.stack([np.interp(rows, rows[agreed], side[agreed]) for side in boxes.T], axis=1)


def usable(box_xywh: Floats) -> bool:
    """Whether a box is finite and has an area."""
    return bool(np.isfinite(box_xywh).all() and (box_xywh[2:] > 0).all())


def _side_by_side(
    pair: Pair, frames: Several[NDArray[np.uint8]], order: Iterable[int], box_xywh: Floats
) -> dict[int, tuple[Floats, Floats]]:
    """Boxes of both trackers by frame, from the first of an order to where they part."""
    start, *others = order
    pair.teacher.init(frames[start], box_xywh)
    pair.second.init(frames[start], box_xywh)
    boxes = {start: (box_xywh, box_xywh)}
    apart = 0
    for index in others:
        teacher, second = (_update(t, frames[index]) for t in (pair.teacher, pair.second))
        boxes[index] = (teacher, second)
        apart = 0 if _iou(teacher, second) >= APART else apart + 1
        if apart == PATIENCE:
            break
    return boxes


def _back(
    teacher: SequenceTracker,
    frames: Several[NDArray[np.uint8]],
    order: Iterable[int],
    runs: dict[int, tuple[Floats, Floats]],
) -> dict[int, Floats]:
    """The teacher's boxes by frame, started on its own last box."""
    start, *others = order
    box = runs[start][0]
    teacher.init(frames[start], box)
    boxes = {start: box}
    apart = 0
    for index in others:
        boxes[index] = _update(teacher, frames[index])
        apart = 0 if _iou(boxes[index], runs[index][0]) >= APART else apart + 1
        if apart == PATIENCE:
            break
    return boxes


def _update(tracker: SequenceTracker, frame: NDArray[np.uint8]) -> Floats:
    box, _ = tracker.update(frame)
    return np.asarray(box, dtype=np.float64)


def _iou(first_xywh: Floats, second_xywh: Floats) -> float:
    return float(overlap(first_xywh[None], second_xywh[None])[0])
