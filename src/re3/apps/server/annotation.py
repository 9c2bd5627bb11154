"""What has been drawn and tracked in a video: objects, key frames, segments, and undo.

An object is a list of key frames. A key frame either holds a box that was drawn, or says that the
object is not followed from there on. A drawn box starts a *segment*: the boxes that the tracker
finds from it on. They depend on that box and on the frames only, not on other objects and not on
earlier boxes, and they count up to the next key frame. So a change of one key frame affects the
frames up to the object's next one, and nothing else.

Objects are immutable; a change makes a new object that shares the segments which it keeps. Undo
therefore brings back tracked boxes at once. Segments only grow, at their end.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from re3.apps.tracking import Box
from re3.result import Result

UNDO_STEPS = 100
"""Changes that can be undone."""

RESULTS_KEPT = 600_000
"""Boxes of all segments, some 250 bytes each, above which the oldest changes are forgotten."""


@dataclass(eq=False)
class Segment:
    """Boxes from a drawn box on, compared by identity.

    Attributes:
        start: frame in which the box was drawn.
        box_xywh: that box, in pixels.
        results: of the frames `start`, `start + 1`, ...; the first is the drawn box.
        wanted: frame up to which it is to be tracked without being asked: where the boxes that it
            replaces reached to.
    """

    start: int
    box_xywh: Box
    results: list[Result]
    wanted: int = -1

    @property
    def until(self) -> int:
        """The last frame that has been tracked."""
        return self.start + len(self.results) - 1


@dataclass(frozen=True)
class TrackedObject:
    """An object of a session.

    Attributes:
        id: 1 for the first; never given twice.
        name: unlike that of any other object.
        colour: as in CSS, `#rrggbb`.
        key_frames: frame -> segment of the box drawn there, or None where the object is not
            followed from there on; in order of frames, the first with a segment.
    """

    id: int
    name: str
    colour: str
    key_frames: Mapping[int, Segment | None]
    _frames: list[int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_frames", list(self.key_frames))

    @property
    def first(self) -> int:
        """The frame in which it was first drawn."""
        return self._frames[0]

    @property
    def given(self) -> dict[int, Box]:
        """Frame -> the box drawn there."""
        return {at: segment.box_xywh for at, segment in self.key_frames.items() if segment}

    @property
    def ends(self) -> list[int]:
        """Frames from which on it is not followed, until the next drawn box."""
        return [at for at, segment in self.key_frames.items() if segment is None]

    def segment_at(self, frame: int) -> Segment | None:
        """The segment that counts in a frame; None where the object is not followed."""
        at = bisect_right(self._frames, frame)
        return self.key_frames[self._frames[at - 1]] if at else None

    def key_frame_after(self, frame: int) -> int | None:
        """The next key frame after a frame."""
        at = bisect_right(self._frames, frame)
        return self._frames[at] if at < len(self._frames) else None

    def is_known(self, frame: int) -> bool:
        """Whether it has been tracked in the frame, or is not followed there."""
        segment = self.segment_at(frame)
        return segment is None or frame <= segment.until

    def result_at(self, frame: int) -> Result | None:
        """What was found in a frame, under the object's id and name; None where nothing was."""
        segment = self.segment_at(frame)
        if segment is None or frame > segment.until:
            return None
        found = segment.results[frame - segment.start]
        return replace(found, object_id=self.id, name=self.name)

    def ranges(self) -> Iterator[tuple[int, int]]:
        """First and last frames of the stretches in which it has boxes, one for each segment."""
        for at, segment in self.key_frames.items():
            if segment is not None:
                following = self.key_frame_after(at)
                yield at, segment.until if following is None else min(segment.until, following - 1)

    def gaps(self, last: int) -> Iterator[tuple[int, int]]:
        """First and last frames of the stretches, up to frame `last`, that are not tracked yet."""
        for at, known in self.ranges():
            following = self.key_frame_after(at)
            end = last if following is None else min(last, following - 1)
            if known < end:
                yield known + 1, end

    @property
    def last_known(self) -> int:
        """The last frame in which it has a box, or that says that it has none."""
        return max(self._frames[-1], *(known for _, known in self.ranges()))

    def with_key_frame(self, frame: int, segment: Segment | None) -> TrackedObject:
        """The object with a key frame set, in place of one that is there."""
        changed = {**self.key_frames, frame: segment}
        kept: dict[int, Segment | None] = {}
        for at in sorted(changed):
            ended = bool(kept) and next(reversed(kept.values())) is None
            if changed[at] is not None or not ended:  # an end after an end says nothing
                kept[at] = changed[at]
        return replace(self, key_frames=kept)

    def without_key_frames_to(self, frame: int) -> TrackedObject | None:
        """The object as it begins after a frame; None where no box is drawn after it."""
        later = {at: segment for at, segment in self.key_frames.items() if at > frame}
        while later and later[min(later)] is None:
            del later[min(later)]
        return replace(self, key_frames=later) if later else None


Objects = Mapping[int, TrackedObject]
"""By id, in order of ids."""


@dataclass(frozen=True)
class Change:
    """A change that can be undone.

    Attributes:
        what: for people, such as "box of person".
        frame: in which it was made.
        before, after: all objects.
    """

    what: str
    frame: int
    before: Objects
    after: Objects

    @property
    def sides(self) -> tuple[Objects, Objects]:
        """Before and after."""
        return self.before, self.after

    def changed_frames(self) -> list[tuple[int, int]]:
        """First and last frames of stretches in which boxes may differ before and after."""
        ids = [i for i in {**self.before, **self.after} if self._differs(i)]
        owners = [side[i] for i in ids for side in self.sides if i in side]
        return [stretch for owner in owners for stretch in owner.ranges()]

    def _differs(self, object_id: int) -> bool:
        before, after = self.before.get(object_id), self.after.get(object_id)
        return before is None or after is None or before.key_frames != after.key_frames


class History:
    """The objects as they are now, and the changes before and after.

    Attributes:
        objects: as they are now; replaced, never changed.
    """

    def __init__(self) -> None:
        self.objects: Objects = {}
        self._done: list[Change] = []
        self._undone: list[Change] = []

    @property
    def undo_change(self) -> Change | None:
        """The change that `undo` takes back."""
        return self._done[-1] if self._done else None

    @property
    def redo_change(self) -> Change | None:
        """The change that `redo` makes again."""
        return self._undone[-1] if self._undone else None

    def make(self, what: str, frame: int, after: Objects) -> None:
        """Make a change; those undone before it are forgotten."""
        self._done.append(Change(what, frame, self.objects, after))
        del self._done[:-UNDO_STEPS]
        self._undone.clear()
        self.objects = after
        while len(self._done) > 1 and self._results() > RESULTS_KEPT:
            del self._done[0]

    def undo(self) -> Change | None:
        """Take the latest change back; None where there is none."""
        if not self._done:
            return None
        change = self._done.pop()
        self._undone.append(change)
        self.objects = change.before
        return change

    def redo(self) -> Change | None:
        """Make the change again that was taken back last; None where there is none."""
        if not self._undone:
            return None
        change = self._undone.pop()
        self._done.append(change)
        self.objects = change.after
        return change

    def _results(self) -> int:
        return sum(len(segment.results) for segment in self.segments())

    def segments(self) -> set[Segment]:
        """All that are in use, or can be brought back."""
        steps = [self.objects, *(side for c in self._done + self._undone for side in c.sides)]
        return {
            segment
            for objects in steps
            for each in objects.values()
            for segment in each.key_frames.values()
            if segment is not None
        }
