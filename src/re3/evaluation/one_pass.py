"""One-pass evaluation: given the truth once, a tracker follows to the end of the clip.

Re3, sec. IV-C; Wu, Lim, Yang: Online object tracking: a benchmark, CVPR 2013. The tracker is
started at the first annotated frame and never again, however far it has strayed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.data.sequence import Sequence
from re3.evaluation.frame_log import FrameLog, Step
from re3.evaluation.peers import SequenceTracker, TrackerFactory
from re3.timed_tracker import time_spent


@dataclass(frozen=True)
class Latency:
    """How long updates, or parts of them, take, in seconds; NaN without any.

    Attributes:
        p50, p95, p99: half, 95 % and 99 % of them take no longer.
    """

    p50: float
    p95: float
    p99: float


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
        decode_seconds: `[T]`, time to read each frame; None where it was not measured.
        unscored: the failure is not the tracker's (frames that cannot be read, a sequence without
            truth, a result that nobody published): there is nothing to score.
        crop_seconds, network_seconds: `[T]`, the parts of `seconds` that went into cutting crops
            and into the network; NaN where the tracker does not tell, None where nobody asked.
    """

    boxes_xywh: NDArray[np.float64]
    scores: NDArray[np.float64]
    seconds: NDArray[np.float64]
    failure: str | None = None
    decode_seconds: NDArray[np.float64] | None = None
    unscored: bool = False
    crop_seconds: NDArray[np.float64] | None = None
    network_seconds: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, log: FrameLog, failure: str | None = None, unscored: bool = False) -> Track:
        """The track of a log."""
        return cls(
            log.boxes_xywh,
            log.scores,
            log.seconds,
            failure,
            log.decode_seconds,
            unscored,
            log.crop_seconds,
            log.network_seconds,
        )

    @property
    def update_seconds(self) -> NDArray[np.float64]:
        """`[N]`, time of each update, without that of the start."""
        return self.seconds[self.update_frames]

    @property
    def update_frames(self) -> NDArray[np.intp]:
        """`[N]`, indices of the frames of those updates."""
        return np.flatnonzero(np.isfinite(self.seconds))[1:]

    @property
    def latency(self) -> Latency:
        """Of the updates, without the start and without decoding."""
        return latency([self])


class TrackerFailure(Exception):
    """A tracker raised or gave something that is not a box."""


class UnreadableFrames(ValueError):
    """The frames of a sequence cannot be read, or there are too few."""


def run_one_pass(
    tracker_factory: TrackerFactory,
    sequence: Sequence,
    on_frame: Callable[[int], None] | None = None,
    log: FrameLog | None = None,
) -> Track:
    """Run a fresh tracker over a sequence once.

    Args:
        tracker_factory: makes the tracker.
        sequence: with at least one annotated frame.
        on_frame: called with the number of frames done, after each.
        log: what the frames are noted in; one of its own by default.

    Returns:
        the track. A tracker that raises, or gives a box that is not four finite numbers, has
        failed: the track says why and has no boxes from there on.

    Raises:
        ValueError: the sequence has no annotated frame.
        UnreadableFrames: its frames cannot be read; a ValueError too.
        Exception: whatever the factory raises.
    """
    first = first_annotated(sequence)
    log = FrameLog(len(sequence), on_frame=on_frame) if log is None else log
    tracker = tracker_factory()
    try:
        for index, (frame, decoded_in) in enumerate(timed_frames(sequence)):
            if index < first:
                log.add(index, Step.SKIPPED, decode_seconds=decoded_in)
                continue
            started = time.perf_counter()
            try:
                if index == first:
                    box, score, step = sequence.start_xywh, 1.0, Step.STARTED
                    start(tracker, frame, box)
                else:
                    box, score = follow(tracker, frame)
                    step = Step.FOLLOWED
            except TrackerFailure as error:
                return Track.of(log, f"frame {index}: {error}")
            seconds = time.perf_counter() - started
            log.add(index, step, box, score, seconds, decoded_in, *time_spent(tracker))
    finally:
        close(tracker)
    return Track.of(log)


def frames_per_second(tracks: Iterable[Track]) -> float:
    """Updates over the time that all of them took together, over all tracks; NaN without any.

    Not one over the median: a tracker that gives up takes next to no time in most frames, and its
    median says nothing of those in which it tracks.
    """
    times = [track.update_seconds for track in tracks]
    seconds = np.concatenate(times) if times else np.empty(0)
    whole = float(seconds.sum())
    return len(seconds) / whole if whole > 0 else float("nan")


def latency(tracks: Iterable[Track]) -> Latency:
    """Percentiles of the time of an update over all tracks."""
    times = [track.update_seconds for track in tracks]
    return percentiles(np.concatenate(times) if times else np.empty(0))


def percentiles(seconds: NDArray[np.float64]) -> Latency:
    """Percentiles of some times `[N]`; NaN among them are left out."""
    seconds = seconds[np.isfinite(seconds)]
    if not seconds.size:
        return Latency(float("nan"), float("nan"), float("nan"))
    return Latency(*(float(value) for value in np.percentile(seconds, (50, 95, 99))))


def decode_time(tracks: Iterable[Track]) -> float:
    """Median time to read a frame, in seconds, over all tracks that have it; NaN without any."""
    times = [t.decode_seconds for t in tracks if t.decode_seconds is not None]
    seconds = np.concatenate(times) if times else np.empty(0)
    seconds = seconds[np.isfinite(seconds)]
    return float(np.median(seconds)) if seconds.size else float("nan")


def first_annotated(sequence: Sequence) -> int:
    """Index of the first frame in which the object has a box.

    Raises:
        ValueError: there is none.
    """
    if not sequence.annotated.any():
        raise ValueError(f"sequence {sequence.name!r} has no annotated frame to start at")
    return int(np.argmax(sequence.annotated))


def timed_frames(sequence: Sequence) -> Iterator[tuple[NDArray[np.uint8], float]]:
    """The frames of a sequence, each with the seconds it took to read it.

    Raises:
        UnreadableFrames: they cannot be read.
    """
    frames = sequence.frames()
    while True:
        started = time.perf_counter()
        try:
            frame = next(frames)
        except StopIteration:
            return
        except (ValueError, OSError, cv2.error) as error:
            raise UnreadableFrames(told(error)) from error
        yield frame, time.perf_counter() - started


def start(tracker: SequenceTracker, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
    """Start a tracker at a box.

    Raises:
        TrackerFailure: it raised.
    """
    try:
        tracker.init(frame, box_xywh)
    except Exception as error:
        raise TrackerFailure(f"init raised {told(error)}") from error


def follow(tracker: SequenceTracker, frame: NDArray[np.uint8]) -> tuple[NDArray[np.float64], float]:
    """The box `[4]` and the score that a tracker gives for the next frame.

    Raises:
        TrackerFailure: it raised, or what it gave is not four finite numbers and a score.
    """
    try:
        given, score = tracker.update(frame)
    except Exception as error:
        raise TrackerFailure(f"update raised {told(error)}") from error
    try:
        box = np.asarray(given, dtype=np.float64)
        score = float(score)
    except (TypeError, ValueError):
        box = np.empty(0)
    if box.shape != (4,) or not np.isfinite(box).all():
        raise TrackerFailure(f"update gave {given!r}; expected four finite numbers and a score")
    return box, score


def close(tracker: SequenceTracker) -> None:
    """Let go of a tracker: calls its `close` where it has one."""
    closing = getattr(tracker, "close", None)
    if closing is not None:
        # The boxes are there; what goes wrong from here on changes none of them.
        with suppress(Exception):
            closing()


def told(error: BaseException) -> str:
    """An exception in one line."""
    # OpenCV's messages have several lines.
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
