"""Tracks segments forward: those that stand at the same frame in one batched call."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence

from re3.apps.server.annotation import Segment
from re3.apps.server.states import StateStore
from re3.apps.tracking import Box
from re3.tracker import MultiTracker
from re3.tracker_state import ObjectState, join_states, split_state
from re3.video import Frame

SPEED_OVER = 30
"""Updates whose mean is the speed shown."""


class SegmentTracker:
    """Makes segments, and appends to them what the tracker finds.

    Where anything fails, segments stay as they were.

    Args:
        new_tracker: makes one without objects.
        read: returns a frame by index; raises `re3.video.SourceError` where there is none.
        states: keeps the tracker's states.

    Attributes:
        tracking_ms: the latest update of the tracker, or 0.
    """

    def __init__(
        self,
        new_tracker: Callable[[], MultiTracker],
        read: Callable[[int], Frame],
        states: StateStore,
    ) -> None:
        self.tracking_ms = 0.0
        self._new_tracker, self._read, self._states = new_tracker, read, states
        self._tracker = new_tracker()
        self._ids: dict[Segment, int] = {}  # in the tracker
        self._at: int | None = None  # the frame that the tracker saw last
        self._recent_ms: deque[float] = deque(maxlen=SPEED_OVER)

    @property
    def fps(self) -> float:
        """Updates of the tracker a second, recently; 0 before the first."""
        return 1000 * len(self._recent_ms) / sum(self._recent_ms) if self._recent_ms else 0.0

    def start(self, frame: Frame, box_xywh: Box) -> Segment:
        """A segment of one frame.

        Raises:
            ValueError: the tracker refuses the box.
        """
        tracker = self._new_tracker()
        identity = tracker.add(frame.image, box_xywh)
        segment = Segment(frame.index, box_xywh, [tracker.results[identity]])
        self._states.put(segment, frame.index, split_state(tracker.save_state())[identity])
        return segment

    def advance(self, segments: Sequence[Segment], frame: Frame) -> None:
        """Track segments into a frame.

        Args:
            segments: tracked up to the frame before.
            frame: the next one.

        Raises:
            SourceError: an earlier frame, needed again, cannot be read.
        """
        self._load(segments, frame.index - 1)
        self._at = None  # until it is done
        started = time.perf_counter()
        found = self._tracker.update(frame.image)
        self.tracking_ms = 1000 * (time.perf_counter() - started)
        self._recent_ms.append(self.tracking_ms)
        states = split_state(self._tracker.save_state())
        for segment, identity in self._ids.items():
            segment.results.append(found[identity])
            self._states.put(segment, frame.index, states[identity])
        self._at = frame.index

    def _load(self, segments: Sequence[Segment], at: int) -> None:
        """Bring the tracker to where it was after a frame, with these segments only."""
        if self._at != at:
            self._ids, self._tracker = {}, self._new_tracker()
        for segment in [each for each in self._ids if each not in segments]:
            self._tracker.remove(self._ids.pop(segment))
        if any(each not in self._ids for each in segments):
            states = [self._state(each, at) for each in segments]
            self._at = None
            self._tracker.load_state(join_states(states))
            self._ids = {segment: number for number, segment in enumerate(segments, start=1)}
        self._at = at

    def _state(self, segment: Segment, at: int) -> ObjectState:
        """The state after a frame of the segment; computed again where it is not kept."""
        near = self._states.nearest(segment, at)
        if near is not None and near[0] == at:
            return near[1]
        tracker = self._new_tracker()
        if near is None:
            reached = segment.start
            tracker.add(self._read(reached).image, segment.box_xywh)
        else:
            reached = near[0]
            tracker.load_state(join_states([near[1]]))
        while reached < at:
            reached += 1
            tracker.update(self._read(reached).image)
        (state,) = split_state(tracker.save_state()).values()
        self._states.put(segment, at, state)
        return state
