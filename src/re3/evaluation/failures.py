"""Where a tracker lost its object, and what the likely cause was.

A *loss* begins in the first of at least `LOSS_FRAMES` annotated frames in a row whose overlap
with the truth is below `LOSS_OVERLAP`, or of fewer that reach to the end of the track. Frames
without truth neither begin nor end one.

The cause is the first of these rules that holds in the *window*, the frames from `WINDOW` before
the loss up to its first frame. The rules read the truth and the tracker's boxes, not the pixels:
what they give is a likely cause, to be looked at.

1. tracker stopped: it gave no box in the frame where the loss begins.
2. occlusion: the dataset marks a frame of the window as occluded.
3. out of view: a frame of the window has no truth; or the true box touches the frame's border as
   the loss begins, with less than `LEAVING` of the largest area it had in the window.
4. fast motion: from one frame to the next the true centre moved by more than `FAST_MOTION` of the
   box's width across or of its height down. From there on a part of the object lies outside a
   search crop of twice the box (Re3, sec. III-A).
5. scale change: the geometric mean of the true width and height changed by more than a factor of
   `SCALE_CHANGE` within the window.
6. aspect change: width over height did, by more than `ASPECT_CHANGE`.
7. distractor: none of these, but the tracker's own box jumped, by more than `FAST_MOTION` of its
   size from one frame to the next.
8. drift: nothing of all that.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.evaluation import metrics

Floats = NDArray[np.float64]

LOSS_OVERLAP = 0.1
LOSS_FRAMES = 10
WINDOW = 10
FAST_MOTION = 0.5
SCALE_CHANGE = 1.5
ASPECT_CHANGE = 1.5
LEAVING = 0.75
BORDER = 1.0
"""A box is at the frame's border within this many pixels."""


class Cause(str, Enum):
    """The likely cause of a loss; see the head of this module."""

    STOPPED = "tracker stopped"
    OCCLUSION = "occlusion"
    OUT_OF_VIEW = "out of view"
    FAST_MOTION = "fast motion"
    SCALE_CHANGE = "scale change"
    ASPECT_CHANGE = "aspect change"
    DISTRACTOR = "distractor"
    DRIFT = "drift"


@dataclass(frozen=True)
class Loss:
    """Frames of the track, 0-based, through which the object was lost.

    Attributes:
        start: the first frame.
        end: one past the last annotated frame below the threshold.
        final: the track ends before the object is found again.
    """

    start: int
    end: int
    final: bool


@dataclass(frozen=True)
class Finding:
    """The likely cause of a loss and what speaks for it, in words."""

    cause: Cause
    evidence: str


def frame_overlaps(predicted_xywh: ArrayLike, truth_xywh: ArrayLike) -> Floats:
    """Overlap `[T]` of each frame: 1 where the tracker was started, NaN without truth.

    Raises:
        ValueError: shapes differ or are not `[T, 4]`, or no frame has truth.
    """
    truth = np.asarray(truth_xywh, dtype=np.float64)
    annotated = np.isfinite(truth).all(axis=-1)
    overlaps = np.full(len(truth), np.nan)
    overlaps[annotated] = metrics.overlap(*metrics.with_given_frame(predicted_xywh, truth))
    return overlaps


def find_losses(overlaps: ArrayLike) -> list[Loss]:
    """Every loss of a track, in order.

    Args:
        overlaps: `[T]`, from `frame_overlaps`.
    """
    values = np.asarray(overlaps, dtype=np.float64)
    frames = np.flatnonzero(~np.isnan(values))
    below = values[frames] < LOSS_OVERLAP
    # Where runs of frames below begin, and one past their ends.
    steps = np.diff(np.concatenate([[False], below, [False]]).astype(np.int8))
    losses = []
    for begin, end in zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1), strict=True):
        final = end == len(frames)
        if final or end - begin >= LOSS_FRAMES:
            losses.append(Loss(int(frames[begin]), int(frames[end - 1]) + 1, bool(final)))
    return losses


def explain(
    loss: Loss,
    predicted_xywh: ArrayLike,
    truth_xywh: ArrayLike,
    occluded: NDArray[np.bool_] | None = None,
    frame_size: tuple[int, int] | None = None,
) -> Finding:
    """The likely cause of a loss.

    Args:
        loss: from `find_losses`.
        predicted_xywh, truth_xywh: `[T, 4]` of the whole track, in pixels.
        occluded: `[T]`, where the dataset marks occlusion.
        frame_size: width and height of the frames in pixels; without it the frame's border is
            not considered.
    """
    predicted = np.asarray(predicted_xywh, dtype=np.float64)
    truth = np.asarray(truth_xywh, dtype=np.float64)
    if not np.isfinite(predicted[loss.start]).all():
        return Finding(Cause.STOPPED, f"no box in frame {loss.start}")
    first = max(loss.start - WINDOW, int(np.argmax(np.isfinite(truth).all(axis=-1))))
    window = slice(first, loss.start + 1)
    if occluded is not None and occluded[window].any():
        frame = first + int(np.argmax(occluded[window]))
        return Finding(Cause.OCCLUSION, f"marked as occluded in frame {frame}")
    return (
        _out_of_view(truth[window], first, frame_size)
        or _fast_motion(truth[window], first)
        or _change_of_size(truth[window])
        or _change_of_aspect(truth[window])
        or _jump_of_tracker(predicted[window], first)
        or Finding(Cause.DRIFT, "no sudden change of the object or of the tracker's box")
    )


def _out_of_view(truth: Floats, first: int, frame_size: tuple[int, int] | None) -> Finding | None:
    absent = ~np.isfinite(truth).all(axis=-1)
    if absent.any():
        frame = first + int(np.argmax(absent))
        return Finding(Cause.OUT_OF_VIEW, f"no truth in frame {frame}: absent or not annotated")
    if frame_size is None:
        return None
    x, y, w, h = truth[-1]
    outermost = (x, y, frame_size[0] - x - w, frame_size[1] - y - h)
    left_over = float(w * h / np.prod(truth[:, 2:], axis=1).max())
    if min(outermost) > BORDER or left_over >= LEAVING:
        return None
    return Finding(
        Cause.OUT_OF_VIEW,
        f"at the frame's border, with {left_over:.0%} of the area it had shortly before",
    )


def _fast_motion(truth: Floats, first: int) -> Finding | None:
    moved = _steps(truth)
    if not moved.size or moved.max() <= FAST_MOTION:
        return None
    row, axis = np.unravel_index(int(np.argmax(moved)), moved.shape)
    frame, side = first + int(row), ("width", "height")[int(axis)]
    return Finding(
        Cause.FAST_MOTION,
        f"centre moved {moved.max():.2f} of the {side} from frame {frame} to {frame + 1}",
    )


def _change_of_size(truth: Floats) -> Finding | None:
    factor = _range(np.sqrt(np.prod(truth[:, 2:], axis=1)))
    if factor <= SCALE_CHANGE:
        return None
    return Finding(Cause.SCALE_CHANGE, f"size changed {factor:.1f}-fold in {len(truth)} frames")


def _change_of_aspect(truth: Floats) -> Finding | None:
    factor = _range(truth[:, 2] / truth[:, 3])
    if factor <= ASPECT_CHANGE:
        return None
    return Finding(
        Cause.ASPECT_CHANGE, f"width over height changed {factor:.1f}-fold in {len(truth)} frames"
    )


def _jump_of_tracker(predicted: Floats, first: int) -> Finding | None:
    # Frames before the start have no box, and a step from or to them is none.
    moved = np.nan_to_num(_steps(predicted), nan=0.0)
    if not moved.size or moved.max() <= FAST_MOTION:
        return None
    frame = first + int(np.argmax(moved.max(axis=1)))
    return Finding(
        Cause.DISTRACTOR,
        f"the tracker's box jumped by {moved.max():.2f} of its size from frame {frame} "
        f"to {frame + 1}, the object did not",
    )


def _steps(boxes: Floats) -> Floats:
    """Motion of the centres `[N - 1, 2]` from one box to the next, in sizes of the first."""
    centres = boxes[:, :2] + boxes[:, 2:] / 2
    return np.abs(np.diff(centres, axis=0)) / boxes[:-1, 2:]


def _range(values: Floats) -> float:
    """The largest value over the smallest."""
    return float(values.max() / values.min())
