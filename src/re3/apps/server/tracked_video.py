"""A video and the objects followed in it: step, go back, correct, add and remove, exactly.

What comes out depends on the video and the boxes given alone, not on the way the user took: each
frame is tracked from the state after the frame before, and a box given takes the place of the one
found. Going back restores the state of that frame; a change there makes the later frames be tracked
again, where the boxes given for them count again.

The frames tracked have no gap: they reach from the first box given to the last frame that is up to
date. Frames before them can be shown without tracking, frames after them only by way of them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from re3 import geometry
from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.states import SavedState, StateStore
from re3.apps.tracking import Box
from re3.result import Result
from re3.tracker import MultiTracker
from re3.video import Frame, SourceError
from re3.video.draw import colour_of

SPEED_OVER = 30
"""Updates whose mean is the speed shown."""


class Video(Protocol):
    """Frames by index; `re3.apps.server.remote_video.RemoteVideo` is one."""

    @property
    def frame_count(self) -> int | None: ...

    def read(self, index: int) -> Frame | None: ...


@dataclass
class TrackedObject:
    """An object of a session.

    Attributes:
        id: 1 for the first; never given twice.
        name: unlike that of any other object.
        colour: as in CSS, `#rrggbb`.
        given: frame -> the box drawn there, x, y, width, height in pixels.
        ends: frames from which on it is not followed, until a box is given again.
    """

    id: int
    name: str
    colour: str
    given: dict[int, Box] = field(default_factory=dict)
    ends: set[int] = field(default_factory=set)

    @property
    def first(self) -> int:
        """The frame it was first drawn in."""
        return min(self.given)


@dataclass(frozen=True)
class TrackedFrame:
    """What is known of one frame.

    Attributes:
        timestamp: seconds from the first frame.
        results: object -> result.
    """

    timestamp: float
    results: dict[int, Result]


class TrackedVideo:
    """See the module. Not for several threads at once.

    Args:
        video: with at least one frame.
        tracker: without objects.
        limits: of the server.
        states: keeps the tracker's states.

    Attributes:
        frame: the one shown.
        objects: by id.
        tracked: frame index -> what was found, for all frames that are up to date.
        broken: why the video ended early, or None.
        tracking_ms: the latest update of the tracker, or 0.
    """

    def __init__(
        self, video: Video, tracker: MultiTracker, limits: Limits, states: StateStore | None = None
    ) -> None:
        self.objects: dict[int, TrackedObject] = {}
        self.tracked: dict[int, TrackedFrame] = {}
        self.broken: str | None = None
        self.tracking_ms = 0.0
        self._video, self._tracker, self._limits = video, tracker, limits
        self._states = states if states is not None else StateStore()
        self._ids: dict[int, int] = {}
        self._tracker_at: int | None = None
        self._next_id = 1
        self._recent_ms: deque[float] = deque(maxlen=SPEED_OVER)
        first = video.read(0)
        if first is None:
            raise SourceError("the video has no frame; expected at least one")
        self.frame = first

    @property
    def position(self) -> int:
        """Index of the frame shown."""
        return self.frame.index

    @property
    def frame_count(self) -> int | None:
        """Of the video, as far as known."""
        return self._video.frame_count

    @property
    def start(self) -> int | None:
        """The first frame with a box given, or None."""
        return min((each.first for each in self.objects.values()), default=None)

    @property
    def tracked_until(self) -> int | None:
        """The last frame that is up to date, or None."""
        return max(self.tracked, default=None)

    @property
    def fps(self) -> float:
        """Updates of the tracker a second, of late; 0 before the first."""
        return 1000 * len(self._recent_ms) / sum(self._recent_ms) if self._recent_ms else 0.0

    def results_at(self, index: int) -> list[Result]:
        """What was found in a frame, by object; empty where nothing was looked for."""
        if index not in self.tracked:
            return []
        results = sorted(self.tracked[index].results.items())
        return [
            replace(found, object_id=each, name=self.objects[each].name) for each, found in results
        ]

    def can_show(self, index: int) -> bool:
        """Whether the frame can be shown without tracking others first."""
        return self.start is None or index < self.start or index in self.tracked

    def last_shown_before(self, index: int) -> int:
        """The latest frame up to `index` that `can_show`."""
        if self.can_show(index):
            return index
        return max(self.tracked) if self.tracked else max(0, (self.start or 0) - 1)

    def show(self, index: int) -> bool:
        """Go to a frame that `can_show`; False where the video has none such."""
        frame = self._read(index)
        if frame is not None:
            self.frame = frame
        return frame is not None

    def forward(self) -> bool:
        """Go to the next frame, tracking where it has not been; False at the end of the video."""
        index = self.position + 1
        if self.can_show(index):
            return self.show(index)
        self._bring_tracker_to(index - 1)
        frame = self._read(index)
        if frame is None:
            return False
        self._step(frame)
        self._remember(frame)
        self.frame = frame
        return True

    def add(
        self, box_xywh: Sequence[float], name: str | None = None, colour: str | None = None
    ) -> TrackedObject:
        """Follow another object from the frame shown on.

        Raises:
            ValueError: a box of no use, or the name of another object.
            OverLimitError: too many objects.
        """
        self._limits.check_objects(len(self.objects))
        box = self._checked(box_xywh)
        new = TrackedObject(
            self._next_id,
            self._checked_name(name, None),
            colour or css_colour(self._next_id),
            {self.position: box},
        )
        self._bring_tracker_to(self.position)
        self._next_id += 1
        self.objects[new.id] = new
        self._give(new, self.frame)
        self._track_anew_from_here()
        return new

    def correct(self, object_id: int, box_xywh: Sequence[float]) -> None:
        """Give an object's box in the frame shown, and go on from it.

        Raises:
            KeyError: no such object.
            ValueError: a box of no use.
        """
        changed = self.objects[object_id]
        box = self._checked(box_xywh)
        self._bring_tracker_to(self.position)
        changed.given[self.position] = box
        changed.ends.discard(self.position)
        self._give(changed, self.frame)
        self._track_anew_from_here()

    def end(self, object_id: int) -> None:
        """Follow an object no more from the frame shown on; its boxes before stay.

        In the frame in which it was first drawn this is to remove it.

        Raises:
            KeyError: no such object.
        """
        ended = self.objects[object_id]
        if ended.first >= self.position:
            self.remove(object_id)
            return
        self._bring_tracker_to(self.position)
        ended.given = {at: box for at, box in ended.given.items() if at < self.position}
        ended.ends = {at for at in ended.ends if at < self.position} | {self.position}
        self._drop(object_id)
        self._track_anew_from_here()

    def remove(self, object_id: int) -> None:
        """Forget an object and all its boxes; those of the others stay.

        Raises:
            KeyError: no such object.
        """
        del self.objects[object_id]
        # Saved states that hold it are mended as they are loaded.
        self._drop(object_id)
        for found in self.tracked.values():
            found.results.pop(object_id, None)
        start = self.start
        for index in [each for each in self.tracked if start is None or each < start]:
            del self.tracked[index]
            self._states.drop(index)
        if not self.tracked:
            self._tracker_at = None

    def change(self, object_id: int, name: str | None = None, colour: str | None = None) -> None:
        """Call or colour an object otherwise, in all frames.

        Raises:
            KeyError: no such object.
            ValueError: no name, or that of another object.
        """
        changed = self.objects[object_id]
        if name is not None:
            changed.name = self._checked_name(name, object_id)
        if colour is not None:
            changed.colour = colour

    def _checked(self, box_xywh: Sequence[float]) -> Box:
        height, width = self.frame.image.shape[:2]
        x, y, w, h = (float(v) for v in geometry.validate_box(box_xywh, width, height))
        return x, y, w, h

    def _checked_name(self, name: str | None, own: int | None) -> str:
        others = {each.name for each in self.objects.values() if each.id != own}
        if name is None:
            number = self._next_id
            while f"object {number}" in others:
                number += 1
            return f"object {number}"
        name = " ".join(name.split())
        if not name:
            raise ValueError("the name is empty; expected at least one letter")
        if name in others:
            raise ValueError(f"another object is called {name!r}; give each a name of its own")
        return name

    def _read(self, index: int) -> Frame | None:
        if index == self.position:
            return self.frame
        try:
            return self._video.read(index)
        except (OverLimitError, SourceError) as error:
            self.broken = str(error)
        return None

    def _bring_tracker_to(self, index: int) -> None:
        """Let the tracker be as it was after a frame that is up to date, or before all of them."""
        if self._tracker_at == index:
            return
        near = self._states.nearest(index)
        if index not in self.tracked or near is None:
            at = index if index not in self.tracked else min(self.tracked) - 1
            for each in list(self._ids):
                self._drop(each)
        else:
            at, saved = near
            self._load(saved)
        while at < index:
            at += 1
            frame = self._read(at)
            if frame is None:
                self._tracker_at = None
                raise SourceError(f"frame {at} cannot be read a second time: {self.broken}")
            self._step(frame)
        self._tracker_at = index

    def _step(self, frame: Frame) -> None:
        """Track into the frame, and take the boxes given there."""
        self._tracker_at = None  # until it is done
        for each in list(self._ids):
            if frame.index in self.objects[each].ends:
                self._drop(each)
        started = time.perf_counter()
        self._tracker.update(frame.image)
        if self._ids:
            self.tracking_ms = 1000 * (time.perf_counter() - started)
            self._recent_ms.append(self.tracking_ms)
        for owner in self.objects.values():
            if frame.index in owner.given:
                self._give(owner, frame)
        self._tracker_at = frame.index

    def _give(self, owner: TrackedObject, frame: Frame) -> None:
        self._drop(owner.id)
        self._ids[owner.id] = self._tracker.add(
            frame.image, owner.given[frame.index], name=owner.name
        )

    def _drop(self, object_id: int) -> None:
        if object_id in self._ids:
            self._tracker.remove(self._ids.pop(object_id))

    def _load(self, saved: SavedState) -> None:
        self._tracker.load_state(saved.arrays)
        self._ids = dict(saved.ids)
        for each in [each for each in self._ids if each not in self.objects]:
            self._drop(each)

    def _remember(self, frame: Frame) -> None:
        found = self._tracker.results
        results = {each: found[identity] for each, identity in self._ids.items()}
        self.tracked[frame.index] = TrackedFrame(frame.timestamp, results)
        saved = SavedState(self._tracker.save_state(), dict(self._ids))
        self._states.put(frame.index, saved)

    def _track_anew_from_here(self) -> None:
        """After a change in the frame shown: what comes after it is not up to date any more."""
        for index in [each for each in self.tracked if each > self.position]:
            del self.tracked[index]
        self._states.drop_after(self.position)
        self._tracker_at = self.position
        self._remember(self.frame)


def css_colour(object_id: int) -> str:
    """The colour that `re3 track` draws the object in, as in CSS."""
    blue, green, red = colour_of(object_id)
    return f"#{red:02x}{green:02x}{blue:02x}"
