"""The loop of `re3 track`: frames in, boxes out to the writers."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from re3.result import Result
from re3.timed_tracker import time_spent
from re3.video import Frame, ResultsWriter, SourceError, VideoSource, VideoWriter, draw_results
from re3.video.overlap import ReadAhead, WriteBehind

Box = tuple[float, float, float, float]


class ObjectTracker(Protocol):
    """What the loop asks of a tracker; `re3.MultiTracker` is one."""

    @property
    def results(self) -> dict[int, Result]: ...

    def add(self, frame: NDArray[np.uint8], box_xywh: Box, name: str | None = None) -> int: ...

    def update(self, frame: NDArray[np.uint8]) -> dict[int, Result]: ...


@dataclass
class Tracked:
    """What came of a run.

    Attributes:
        frames: in which objects were followed, the first included.
        seconds: spent in the tracker: crops, network and state, without decoding and encoding.
        crop_seconds, network_seconds: of them those in cutting crops and in the network; NaN
            where the tracker does not tell.
        updates: calls of `update` in that time.
        statuses: number of results by status.
        last: the latest result of each object.
        interrupted: whether it was asked to stop.
        broken: why the source ended early, or None.
        missing: frames that the source announced, but did not give; 0 where it said nothing.
        cut: whether those are surely missing, as far as headers can tell.
        skipped: packets of the source that could not be decoded.
        damaged: indices of frames that the decoder marked as corrupt.
    """

    frames: int = 0
    seconds: float = 0.0
    crop_seconds: float = 0.0
    network_seconds: float = 0.0
    updates: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    last: dict[int, Result] = field(default_factory=dict)
    interrupted: bool = False
    broken: str | None = None
    missing: int = 0
    cut: bool = False
    skipped: int = 0
    damaged: list[int] = field(default_factory=list)

    @property
    def fps(self) -> float:
        """Frames tracked a second; 0 before the first update."""
        return self.updates / self.seconds if self.seconds else 0.0


def track_video(
    source: VideoSource,
    tracker: ObjectTracker,
    objects: Mapping[str, Box],
    video: VideoWriter | None = None,
    results: ResultsWriter | None = None,
    max_frames: int | None = None,
    on_frame: Callable[[Frame, Tracked], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Tracked:
    """Track objects from the source's first frame on, writing as it goes.

    Frames of a file are read ahead, and those of the video encoded behind, in threads.
    Ctrl-C and a source that breaks end the run; what was tracked until then stays written. Frames
    of the video are shown at the times that they have in the source.

    Args:
        source: opened at the frame in which the boxes are.
        tracker: without objects.
        objects: name -> x, y, width, height in pixels of the first frame.
        video, results: open writers, or None.
        max_frames: stop after so many frames.
        on_frame: called after each frame.
        stop: asked after each frame whether to stop.

    Raises:
        ValueError: a box that the tracker refuses.
        SourceError: the source breaks before its first frame, or has none.
        OSError: a writer fails.
    """
    outcome = Tracked()
    try:
        _track(source, tracker, objects, video, results, max_frames, on_frame, stop, outcome)
    except KeyboardInterrupt:
        outcome.interrupted = True
    except SourceError as error:
        if outcome.frames == 0:
            raise
        outcome.broken = str(error)
    outcome.skipped = source.skipped
    return outcome


def _track(
    source: VideoSource,
    tracker: ObjectTracker,
    objects: Mapping[str, Box],
    video: VideoWriter | None,
    results: ResultsWriter | None,
    max_frames: int | None,
    on_frame: Callable[[Frame, Tracked], None] | None,
    stop: Callable[[], bool],
    outcome: Tracked,
) -> None:
    """The loop; see `track_video`."""
    with ExitStack() as stack:
        frames: Iterable[Frame] = source
        # What is live is taken as it comes: frames read ahead would be old ones.
        if source.frame_count is not None:
            frames = stack.enter_context(ReadAhead(source))
        encoder = None
        if video is not None:
            encoder = stack.enter_context(WriteBehind(_write_to(video)))
        for frame in frames:
            _follow(tracker, frame, objects, outcome)
            found = list(outcome.last.values())
            if results is not None:
                height, width = frame.image.shape[:2]
                results.write(
                    frame.index,
                    frame.timestamp,
                    found,
                    image=frame.name,
                    size=(width, height),
                    damaged=frame.damaged,
                )
            if encoder is not None:
                # Drawn here: encoding takes longer than all that goes before it.
                encoder.put((draw_results(frame.image, found), frame.timestamp))
            outcome.frames += 1
            if frame.damaged:
                outcome.damaged.append(frame.index)
            if on_frame is not None:
                on_frame(frame, outcome)
            if outcome.frames == max_frames:
                return
            if stop():
                outcome.interrupted = True
                return
    if outcome.frames == 0:
        raise SourceError(f"{source.name} gave no frame; expected at least one")
    outcome.missing = source.missing_frames(frame)
    outcome.cut = outcome.missing > 0 and source.length_is_certain


def _write_to(video: VideoWriter) -> Callable[[tuple[NDArray[np.uint8], float]], None]:
    def write(shown: tuple[NDArray[np.uint8], float]) -> None:
        video.write(*shown)

    return write


def _follow(
    tracker: ObjectTracker, frame: Frame, objects: Mapping[str, Box], outcome: Tracked
) -> None:
    """Start the objects in the first frame, follow them in every other, and note what it took."""
    if outcome.frames == 0:
        for name, box in objects.items():
            tracker.add(frame.image, box, name)
        outcome.last = tracker.results
    else:
        started = time.perf_counter()
        outcome.last = tracker.update(frame.image)
        outcome.seconds += time.perf_counter() - started
        crop_seconds, network_seconds = time_spent(tracker)
        outcome.crop_seconds += crop_seconds
        outcome.network_seconds += network_seconds
        outcome.updates += 1
    outcome.statuses.update(str(r.status) for r in outcome.last.values())
