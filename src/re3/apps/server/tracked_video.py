"""A video and the objects in it: step, go back, correct, add, remove, undo.

What comes out depends on the video and on the drawn boxes only, not on the order in which they were
drawn: see `re3.apps.server.annotation`. Any frame can be shown at any time; the boxes known there
are shown with it. Stepping forward tracks the objects that are known in the frame before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Protocol

from re3 import geometry
from re3.apps.server import coverage
from re3.apps.server.annotation import Change, History, Objects, Segment, TrackedObject
from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.names import checked_name
from re3.apps.server.segments import SegmentTracker
from re3.apps.server.states import StateStore
from re3.apps.tracking import Box
from re3.result import Result
from re3.tracker import MultiTracker
from re3.video import Frame, SourceError
from re3.video.draw import colour_of


class Video(Protocol):
    """Frames by index; `re3.apps.server.remote_video.RemoteVideo` is one."""

    @property
    def fps(self) -> Fraction: ...

    @property
    def frame_count(self) -> int | None: ...

    def read(self, index: int) -> Frame | None: ...


class TrackedVideo:
    """See the module. Not for several threads at once.

    A change that fails leaves everything as it was.

    Args:
        video: with at least one frame.
        new_tracker: makes a tracker without objects; all of one model.
        limits: of the server.
        states: keeps the tracker's states.

    Attributes:
        frame: the one shown.
        history: the objects, and the changes that can be undone.
        timestamps: frame -> seconds from the first frame, of all frames seen.
        broken: why the video ended early, or None.
    """

    def __init__(
        self,
        video: Video,
        new_tracker: Callable[[], MultiTracker],
        limits: Limits,
        states: StateStore | None = None,
    ) -> None:
        self.history = History()
        self.timestamps: dict[int, float] = {}
        self.broken: str | None = None
        self._video, self._limits = video, limits
        self._states = states if states is not None else StateStore()
        self._tracker = SegmentTracker(new_tracker, self._read_again, self._states)
        self._next_id = 1
        first = video.read(0)
        if first is None:
            raise SourceError("the video has no frame; expected at least one")
        self._show(first)

    @property
    def objects(self) -> Objects:
        """By id."""
        return self.history.objects

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
        """The first frame with a drawn box, or None."""
        return min((each.first for each in self.objects.values()), default=None)

    @property
    def last_known(self) -> int | None:
        """The last frame in which any object is known, or None."""
        return coverage.last_known(self.objects)

    @property
    def tracked_until(self) -> int | None:
        """The last frame up to which all objects are known without a gap, or None."""
        return coverage.tracked_until(self.objects)

    @property
    def tracking_ms(self) -> float:
        """Time of the latest update of the tracker, or 0."""
        return self._tracker.tracking_ms

    @property
    def fps(self) -> float:
        """Updates of the tracker a second, recently; 0 before the first."""
        return self._tracker.fps

    def tracked_frames(self) -> Iterator[int]:
        """The frames that are written to files: from the first drawn box to the last known."""
        last = self.last_known
        return iter(() if last is None else range(self.start or 0, last + 1))

    def timestamp(self, index: int) -> float:
        """Seconds from the first frame; by the frame rate where the frame has not been seen."""
        return self.timestamps.get(index, float(index / self._video.fps))

    def known_frames(self) -> Iterator[int]:
        """Those of `tracked_frames` in which an object was found, or all are known."""
        return (i for i in self.tracked_frames() if self.results_at(i) or self.is_known(i))

    def results_at(self, index: int) -> list[Result]:
        """What was found in a frame, by object; empty where nothing was looked for."""
        found = (each.result_at(index) for _, each in sorted(self.objects.items()))
        return [result for result in found if result is not None]

    def is_known(self, index: int) -> bool:
        """Whether all objects are known in a frame."""
        return all(each.is_known(index) for each in self.objects.values())

    def last_known_before(self, index: int) -> int:
        """The latest frame up to `index` in which all objects are known."""
        return coverage.last_known_before(self.objects, index)

    def untracked(self) -> list[str]:
        """What is not tracked to the video's end, for people; empty where all is."""
        if not self.objects or self.broken is not None or self.frame_count is None:
            end = self.last_known or 0
        else:
            end = max(self.frame_count - 1, self.last_known or 0)
        told = coverage.untracked(self.objects, end)
        if self.objects and self.frame_count is None and self.broken is None:
            told.append(f"what follows frame {end}")
        return told

    def show(self, index: int) -> bool:
        """Go to a frame; False where the video has none such."""
        frame = self._read(index)
        if frame is not None:
            self._show(frame)
        return frame is not None

    def forward(self) -> bool:
        """Go to the next frame, tracking what is known here; False at the end of the video."""
        frame = self._read(self.position + 1)
        if frame is None:
            return False
        self._advance(frame)
        self._show(frame)
        return True

    def catch_up(self) -> int | None:
        """Track a frame further what a change made to be tracked again.

        The frame shown stays.

        Returns:
            the frame, or None where there is nothing to catch up with.
        """
        behind = [segment for segment, _ in coverage.wanted(self.objects)]
        if not behind:
            return None
        index = min(segment.until for segment in behind) + 1
        frame = self._read(index)
        if frame is None:
            self.give_up_catching_up()
            return None
        self._advance(frame)
        return index

    def frames_to_catch_up(self) -> int:
        """Frames that `catch_up` has still to track, of the object that lacks most."""
        return max(
            (until - segment.until for segment, until in coverage.wanted(self.objects)), default=0
        )

    def give_up_catching_up(self) -> None:
        """Leave what is not tracked until it is asked for."""
        for segment, _ in coverage.wanted(self.objects):
            segment.wanted = -1

    def add(
        self, box_xywh: Sequence[float], name: str | None = None, colour: str | None = None
    ) -> TrackedObject:
        """Follow another object from the frame shown on.

        Raises:
            ValueError: a box of no use, or the name of another object.
            OverLimitError: too many objects.
        """
        self._limits.check_objects(len(self.objects))
        name = self._new_name() if name is None else self._checked_name(name, None)
        segment = self._started(box_xywh)
        segment.wanted = self.last_known or 0
        colour = colour or css_colour(self._next_id)
        new = TrackedObject(self._next_id, name, colour, {self.position: segment})
        self._next_id += 1
        self._make(f"new object {name}", new)
        return new

    def correct(self, object_id: int, box_xywh: Sequence[float]) -> None:
        """Draw an object's box in the frame shown; it counts up to the object's next key frame.

        Raises:
            KeyError: no such object.
            ValueError: a box of no use.
        """
        changed = self.objects[object_id]
        segment = self._started(box_xywh)
        replaced = changed.segment_at(self.position)
        reach = self.last_known or 0
        segment.wanted = reach if replaced is None else max(replaced.until, replaced.wanted)
        self._make(f"box of {changed.name}", changed.with_key_frame(self.position, segment))

    def end(self, object_id: int) -> None:
        """Do not follow an object from the frame shown on, until the next box drawn for it.

        In the frame in which it was first drawn this is to forget that box.

        Raises:
            KeyError: no such object.
            ValueError: the object begins later.
        """
        ended = self.objects[object_id]
        what = f"end of {ended.name}"
        if self.position < ended.first:
            raise ValueError(
                f"{ended.name} begins in frame {ended.first}, after frame {self.position}, which "
                "is shown; go to a later frame, or remove it"
            )
        if self.position > ended.first:
            if ended.segment_at(self.position) is not None:
                self._make(what, ended.with_key_frame(self.position, None))
            return
        later = ended.without_key_frames_to(self.position)
        if later is None:
            self.remove(object_id)
        else:
            self._make(what, later)

    def remove(self, object_id: int) -> None:
        """Forget an object and all its boxes; those of the others stay.

        Raises:
            KeyError: no such object.
        """
        removed = self.objects[object_id]
        kept = {i: each for i, each in self.objects.items() if i != object_id}
        self.history.make(f"removal of {removed.name}", self.position, kept)

    def change(self, object_id: int, name: str | None = None, colour: str | None = None) -> None:
        """Call or colour an object otherwise, in all frames.

        Raises:
            KeyError: no such object.
            ValueError: no name, or that of another object.
        """
        old = self.objects[object_id]
        new = replace(
            old,
            name=old.name if name is None else self._checked_name(name, object_id),
            colour=colour or old.colour,
        )
        if new != old:
            self._make(f"{'colour' if new.name == old.name else 'name'} of {old.name}", new)

    def undo(self) -> Change | None:
        """Take the latest change back, and show its frame; None where there is none."""
        return self._gone_to(self.history.undo())

    def redo(self) -> Change | None:
        """Make the change again that was taken back last; None where there is none."""
        return self._gone_to(self.history.redo())

    def _gone_to(self, change: Change | None) -> Change | None:
        if change is not None:
            self.show(change.frame)
        return change

    def _make(self, what: str, changed: TrackedObject) -> None:
        after = {**self.objects, changed.id: changed}
        self.history.make(what, self.position, {i: after[i] for i in sorted(after)})
        self._states.keep_only(self.history.segments())

    def _started(self, box_xywh: Sequence[float]) -> Segment:
        height, width = self.frame.image.shape[:2]
        x, y, w, h = (float(v) for v in geometry.validate_box(box_xywh, width, height))
        box: Box = (x, y, w, h)
        return self._tracker.start(self.frame, box)

    def _new_name(self) -> str:
        names, number = {each.name for each in self.objects.values()}, self._next_id
        while f"object {number}" in names:
            number += 1
        return f"object {number}"

    def _checked_name(self, name: str, own: int | None) -> str:
        name = checked_name(name)
        if name in {each.name for each in self.objects.values() if each.id != own}:
            raise ValueError(f"another object is called {name!r}; give each a name of its own")
        return name

    def _advance(self, frame: Frame) -> None:
        """Track into a frame all objects that are known up to the frame before."""
        before = frame.index - 1
        owners = [each.segment_at(frame.index) for each in self.objects.values()]
        ready = [each for each in owners if each is not None and each.until == before]
        if ready:
            self._tracker.advance(ready, frame)

    def _show(self, frame: Frame) -> None:
        self.frame = frame
        self.timestamps[frame.index] = frame.timestamp

    def _read(self, index: int) -> Frame | None:
        if index == self.position:
            return self.frame
        try:
            frame = self._video.read(index)
        except (OverLimitError, SourceError) as error:
            self.broken = str(error)
            return None
        if frame is not None:
            self.timestamps[index] = frame.timestamp
        return frame

    def _read_again(self, index: int) -> Frame:
        frame = self._read(index)
        if frame is None:
            raise SourceError(f"frame {index} cannot be read a second time: {self.broken}")
        return frame


def css_colour(object_id: int) -> str:
    """The colour that `re3 track` draws the object in, as in CSS."""
    blue, green, red = colour_of(object_id)
    return f"#{red:02x}{green:02x}{blue:02x}"
