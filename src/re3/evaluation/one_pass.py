"""One-pass evaluation: given the truth once, a tracker follows to the end of the clip.

Re3, sec. IV-C; Wu, Lim, Yang: Online object tracking: a benchmark, CVPR 2013. The tracker is
started at the first annotated frame and never again, however far it has strayed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.data.sequence import Sequence
from re3.evaluation.peers import SequenceTracker, TrackerFactory


@dataclass(frozen=True, eq=False)
class Track:
    """What a tracker gave for one sequence.

    Attributes:
        boxes_xywh: float64 `[T, 4]` in pixels. The first annotated frame has the truth, frames
            before it and frames from a failure on are NaN.
        scores: `[T]`, the tracker's own, 0..1; 1 where it was given the truth, NaN where there
            is no box.
        seconds: `[T]`, time in the tracker for each frame, without decoding; that of the first
            annotated frame is the start's. NaN where there is no box.
        failure: why the tracker stopped before the end, with the frame; None where it did not.
    """

    boxes_xywh: NDArray[np.float64]
    scores: NDArray[np.float64]
    seconds: NDArray[np.float64]
    failure: str | None = None

    @property
    def update_seconds(self) -> NDArray[np.float64]:
        """`[N]`, time of each update, without that of the start."""
        return self.seconds[np.isfinite(self.seconds)][1:]


class TrackerFailure(Exception):
    """A tracker raised or gave something that is not a box."""


def run_one_pass(
    tracker_factory: TrackerFactory,
    sequence: Sequence,
    on_frame: Callable[[int], None] | None = None,
) -> Track:
    """Run a fresh tracker over a sequence once.

    Args:
        tracker_factory: makes the tracker.
        sequence: with at least one annotated frame.
        on_frame: called with the number of frames done, after each.

    Returns:
        the track. A tracker that raises, or gives a box that is not four finite numbers, has
        failed: the track says why and has no boxes from there on.

    Raises:
        ValueError: the sequence has no annotated frame, or its frames cannot be read.
        Whatever the factory raises.
    """
    if not sequence.annotated.any():
        raise ValueError(f"sequence {sequence.name!r} has no annotated frame to start at")
    first = int(np.argmax(sequence.annotated))
    boxes = np.full((len(sequence), 4), np.nan)
    scores = np.full(len(sequence), np.nan)
    seconds = np.full(len(sequence), np.nan)
    tracker = tracker_factory()
    for index, frame in enumerate(sequence.frames()):
        if index >= first:
            started = time.perf_counter()
            try:
                if index == first:
                    truth = sequence.boxes_xywh[first]
                    _start(tracker, frame, truth)
                    box, score = truth, 1.0
                else:
                    box, score = _follow(tracker, frame)
            except TrackerFailure as error:
                return Track(boxes, scores, seconds, f"frame {index}: {error}")
            seconds[index] = time.perf_counter() - started
            boxes[index], scores[index] = box, score
        if on_frame is not None:
            on_frame(index + 1)
    return Track(boxes, scores, seconds)


def frames_per_second(tracks: Iterable[Track]) -> float:
    """One over the median time of an update over all tracks; NaN without any.

    The median, because the first updates of a network warm caches up and a busy machine stalls
    single frames.
    """
    times = [track.update_seconds for track in tracks]
    seconds = np.concatenate(times) if times else np.empty(0)
    return float(1.0 / np.median(seconds)) if seconds.size else float("nan")


def _start(tracker: SequenceTracker, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
    try:
        tracker.init(frame, box_xywh)
    except Exception as error:
        raise TrackerFailure(f"init raised {_told(error)}") from error


def _follow(
    tracker: SequenceTracker, frame: NDArray[np.uint8]
) -> tuple[NDArray[np.float64], float]:
    try:
        given, score = tracker.update(frame)
    except Exception as error:
        raise TrackerFailure(f"update raised {_told(error)}") from error
    try:
        box = np.asarray(given, dtype=np.float64)
        score = float(score)
    except (TypeError, ValueError):
        box = np.empty(0)
    if box.shape != (4,) or not np.isfinite(box).all():
        raise TrackerFailure(f"update gave {given!r}; expected four finite numbers and a score")
    return box, score


def _told(error: Exception) -> str:
    # OpenCV's messages have several lines.
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
