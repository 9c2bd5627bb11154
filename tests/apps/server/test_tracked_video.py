"""Stepping, going back, correcting: what comes out depends on the boxes given alone."""

from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.states import StateStore
from re3.apps.server.tracked_video import TrackedVideo
from re3.engine import load_engine
from re3.tracker import MultiTracker
from re3.video import SourceError, open_source

CLIP = Path(__file__).parents[3] / "examples" / "clips" / "person.mp4"
PERSON = (368.25, 58.5, 158.0, 374.0)
TABLE = (440.0, 80.0, 146.0, 260.0)
FRAMES = 14
ENGINE = load_engine("re3-lite")


class Frames:
    """The first frames of the clip, in memory; breaks at `breaks_at`."""

    fps = Fraction(10)

    def __init__(self, count=FRAMES, breaks_at=None):
        self.count, self.breaks_at, self.frame_count = count, breaks_at, None
        with open_source(CLIP) as source:
            self.frames = [frame for _, frame in zip(range(count), source, strict=False)]

    def read(self, index):
        if index == self.breaks_at:
            raise SourceError(f"broken after frame {index - 1}")
        if index >= self.count:
            self.frame_count = self.count
            return None
        return self.frames[index]


@pytest.fixture(scope="module")
def frames():
    return Frames()


def tracked_video(video, budget=1 << 28, **limits):
    new = partial(MultiTracker, engine=ENGINE)
    return TrackedVideo(video, new, Limits(**limits), StateStore(budget))


def go_to(video, index):
    video.show(video.last_known_before(index))
    while video.position < index:
        assert video.forward()


def catch_up(video):
    """Frames that were tracked again."""
    frames = []
    while (index := video.catch_up()) is not None:
        frames.append(index)
    return frames


def boxes(video, until=FRAMES - 1):
    return {
        index: {result.object_id: (result.box_xywh, result.score) for result in results}
        for index in range(until + 1)
        if (results := video.results_at(index))
    }


def same(found, expected):
    """Whether boxes are the same but for the last digits, which the size of a batch changes."""
    flat = [
        {
            (at, who): (*box, score)
            for at, each in some.items()
            for who, (box, score) in each.items()
        }
        for some in (found, expected)
    ]
    return flat[0].keys() == flat[1].keys() and all(
        flat[0][key] == pytest.approx(flat[1][key], abs=1e-4) for key in flat[0]
    )


def plain(frames, given, until=FRAMES - 1):
    """The same with the tracker alone: boxes given as {(frame, object): box}."""
    tracker, ids, found = MultiTracker(engine=ENGINE), {}, {}
    for index in range(until + 1):
        image = frames.frames[index].image
        tracker.update(image)
        for (at, who), box in given.items():
            if at == index:
                if who in ids:
                    tracker.remove(ids[who])
                ids[who] = tracker.add(image, box)
        if ids:
            results = tracker.results
            found[index] = {w: (results[i].box_xywh, results[i].score) for w, i in ids.items()}
    return found


def test_it_finds_what_the_tracker_finds(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    go_to(video, FRAMES - 1)
    assert not video.forward()
    assert video.frame_count == FRAMES
    assert same(boxes(video), plain(frames, {(0, 1): PERSON}))


def test_a_correction_far_back_makes_the_rest_be_tracked_again(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    go_to(video, 10)
    video.show(4)
    video.correct(1, TABLE)
    assert video.tracked_until == 4
    assert catch_up(video) == [5, 6, 7, 8, 9, 10]
    assert video.position == 4
    assert same(boxes(video), plain(frames, {(0, 1): PERSON, (4, 1): TABLE}, 10))


def test_a_correction_stays_when_something_earlier_changes(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    go_to(video, 8)
    video.correct(1, TABLE)
    video.show(3)
    video.add(TABLE, "table")
    go_to(video, 10)
    assert same(boxes(video), plain(frames, {(0, 1): PERSON, (3, 2): TABLE, (8, 1): TABLE}, 10))


@pytest.mark.parametrize("budget", [0, 600_000, 1 << 28])
def test_the_way_taken_and_the_memory_for_states_do_not_matter(frames, budget):
    video = tracked_video(frames, budget)
    video.add(PERSON)
    go_to(video, 9)
    for index in (2, 7, 0, 9, 5):
        video.show(index)
        assert video.position == index
    video.correct(1, TABLE)
    video.correct(1, PERSON)
    go_to(video, 9)
    video.show(1)
    video.add(TABLE, "table")
    go_to(video, 11)
    given = {(0, 1): PERSON, (1, 2): TABLE, (5, 1): PERSON}
    assert same(boxes(video), plain(frames, given, 11))


def test_an_object_may_begin_later_and_another_before_it(frames):
    video = tracked_video(frames)
    go_to(video, 6)
    assert video.tracked_until is None
    video.add(PERSON)
    go_to(video, 8)
    video.show(2)
    video.add(TABLE)
    go_to(video, 8)
    assert same(boxes(video), plain(frames, {(6, 1): PERSON, (2, 2): TABLE}, 8))


def test_an_object_ends_where_it_was_ended_and_may_come_back(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    video.add(TABLE, "table")
    go_to(video, 8)
    video.show(4)
    video.end(2)
    go_to(video, 8)
    assert [len(boxes(video)[index]) for index in range(9)] == [2] * 4 + [1] * 5
    video.show(6)
    video.correct(2, TABLE)
    go_to(video, 8)
    gap = [2] * 4 + [1] * 2 + [2] * 3
    assert [len(boxes(video)[index]) for index in range(9)] == gap
    video.show(2)
    video.correct(1, PERSON)
    go_to(video, 8)
    assert [len(boxes(video)[index]) for index in range(9)] == gap
    assert video.objects[2].ends == [4]
    video.show(3)
    video.end(2)
    assert video.objects[2].ends == [3]
    video.show(0)
    video.end(2)
    assert (video.objects[2].first, sorted(boxes(video)[6])) == (6, [1, 2])
    with pytest.raises(ValueError, match=r"begins in frame 6.*go to a later frame"):
        video.end(2)


def test_a_removed_object_leaves_nothing_and_the_others_alone(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    video.add(TABLE, "table")
    go_to(video, 6)
    video.remove(1)
    assert [list(found) for found in boxes(video).values()] == [[2]] * 7
    go_to(video, 8)
    video.show(3)
    video.add(PERSON, "again")
    go_to(video, 8)
    assert list(boxes(video)[8]) == [2, 3]
    video.remove(2)
    assert video.start == 3
    video.remove(3)
    video.show(0)
    go_to(video, 9)
    assert boxes(video) == {}


def test_ending_an_object_in_its_first_frame_removes_it(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    video.end(1)
    assert video.objects == {}


def test_names(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    video.add(TABLE, "  the \n table ")
    assert [each.name for each in video.objects.values()] == ["object 1", "the table"]
    with pytest.raises(ValueError, match="another object is called 'the table'"):
        video.change(1, name="the table")
    with pytest.raises(ValueError, match="the name is empty"):
        video.change(1, name=" ")
    video.change(2, name="the table")
    video.change(1, name="object 3", colour="#123456")
    assert video.add(PERSON).name == "object 4"
    assert [result.name for result in video.results_at(0)] == ["object 3", "the table", "object 4"]
    assert video.objects[1].colour == "#123456"


def test_limits_and_boxes_of_no_use(frames):
    video = tracked_video(frames, objects=1)
    for box in [(0, 0, 0, 0), (-50, 0, 40, 40), (float("nan"), 0, 1, 1)]:
        with pytest.raises(ValueError, match="box"):
            video.add(box)
    assert video.objects == {}
    video.add(PERSON)
    with pytest.raises(OverLimitError, match=r"has 1 objects.*--max-objects"):
        video.add(TABLE)
    with pytest.raises(KeyError):
        video.correct(2, TABLE)


def test_a_video_that_breaks_keeps_what_there_was():
    video = tracked_video(Frames(8, breaks_at=5))
    video.add(PERSON)
    go_to(video, 4)
    assert not video.forward()
    assert video.broken == "broken after frame 4"
    assert video.position == 4
    assert len(boxes(video)) == 5
    video.show(2)
    video.correct(1, PERSON)
    go_to(video, 4)


def test_a_video_without_frames_is_refused():
    with pytest.raises(SourceError, match="no frame"):
        tracked_video(Frames(0))


def an_array(value):
    return {"a": np.full(100, value, np.float64)}


def test_states_are_thinned_out_evenly():
    store = StateStore(budget=60 * 800)
    for frame in range(400):
        store.put("one", frame, an_array(frame))
    assert 30 < len(store) <= 61
    for frame in (399, 390, 376):
        assert store.nearest("one", frame)[0] == frame
    assert all(frame - store.nearest("one", frame)[0] <= 32 for frame in range(400))
    at, state = store.nearest("one", 399)
    assert state["a"][0] == at
    assert StateStore().nearest("one", 5) is None


def test_states_of_many_segments_stay_within_the_budget():
    store = StateStore(budget=60 * 800)
    for owner in range(200):
        for frame in range(40):
            store.put(owner, frame, an_array(owner))
    assert len(store) <= 16 * 26
    assert store.nearest(199, 39)[0] == 39
    assert store.nearest(0, 39) is None
    store.keep_only([199])
    assert store.nearest(198, 39) is None
    assert 20 < len(store) <= 40


def everything(frames, changes):
    """A clip tracked to frame 9 with two objects, and boxes before and after `changes(video)`."""
    video = tracked_video(frames)
    video.add(PERSON, "person")
    video.add(TABLE, "table")
    go_to(video, 9)
    before = boxes(video)
    changes(video)
    return video, before


def at(frame, act):
    def change(video):
        video.show(frame)
        act(video)

    return change


NUDGED = (PERSON[0] + 5, *PERSON[1:])
THIRD = (300.0, 40.0, 200.0, 300.0)


@pytest.mark.parametrize(
    ("change", "changed", "again"),
    [
        (at(0, lambda v: v.correct(1, NUDGED)), {1}, range(1, 10)),
        (at(4, lambda v: v.correct(2, PERSON)), {2}, range(5, 10)),
        (at(9, lambda v: v.correct(2, PERSON)), {2}, ()),
        (at(0, lambda v: v.add(THIRD)), {3}, range(1, 10)),
        (at(6, lambda v: v.add(THIRD)), {3}, range(7, 10)),
        (at(4, lambda v: v.end(1)), {1}, ()),
        (at(0, lambda v: v.end(2)), {2}, ()),
        (at(5, lambda v: v.remove(1)), {1}, ()),
        (at(5, lambda v: v.change(1, "other", "#123456")), set(), ()),
    ],
    ids=["nudge", "correct", "last", "add", "later", "end", "end at first", "remove", "name"],
)
def test_a_change_affects_one_object_and_undo_takes_it_back(frames, change, changed, again):
    video, before = everything(frames, change)
    position = video.position
    for index in range(10):
        now = boxes(video).get(index, {})
        others = {i: found for i, found in now.items() if i not in changed}
        assert others == {i: found for i, found in before[index].items() if i not in changed}
        assert (
            index >= position
            or now == before[index]
            or video.history.undo_change.what.startswith("removal")
        )
    assert catch_up(video) == list(again)
    assert video.tracked_until == 9 or changed == {2}
    after = boxes(video)
    names = [each.name for each in video.objects.values()]
    video.show(2)
    assert video.undo().frame == video.position == position
    assert boxes(video) == before
    assert [each.name for each in video.objects.values()] == ["person", "table"]
    assert catch_up(video) == []
    video.redo()
    assert boxes(video) == after
    assert [each.name for each in video.objects.values()] == names
    assert video.redo() is None


def test_a_correction_reaches_up_to_the_next_drawn_box(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    go_to(video, 9)
    video.show(6)
    video.correct(1, TABLE)
    assert catch_up(video) == [7, 8, 9]
    later = {index: found for index, found in boxes(video).items() if index >= 6}
    video.show(2)
    video.correct(1, NUDGED)
    assert list(video.objects[1].ranges()) == [(0, 1), (2, 2), (6, 9)]
    assert video.untracked()[0] == "object 1 in frames 3 to 5, 10 to 13"
    assert catch_up(video) == [3, 4, 5]
    assert {index: found for index, found in boxes(video).items() if index >= 6} == later
    assert same(boxes(video, 9), plain(frames, {(0, 1): PERSON, (2, 1): NUDGED, (6, 1): TABLE}, 9))


def test_a_box_dragged_twice_is_tracked_as_far_as_before(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    go_to(video, 9)
    video.show(0)
    video.correct(1, NUDGED)
    assert [video.catch_up() for _ in range(3)] == [1, 2, 3]
    video.correct(1, PERSON)
    assert video.frames_to_catch_up() == 9
    assert catch_up(video) == list(range(1, 10))
    assert same(boxes(video, 9), plain(frames, {(0, 1): PERSON}, 9))
    video.correct(1, NUDGED)
    video.give_up_catching_up()
    assert catch_up(video) == []
    assert video.tracked_until == 0


def test_frames_can_be_looked_at_and_drawn_in_without_tracking(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    assert video.show(8)
    assert video.results_at(8) == []
    video.correct(1, TABLE)
    assert video.forward()
    assert list(video.objects[1].ranges()) == [(0, 0), (8, 9)]
    assert video.tracked_until == 0
    assert list(video.tracked_frames()) == list(range(10))
    assert list(video.known_frames()) == [0, 8, 9]
    assert video.last_known_before(7) == 0
    assert video.timestamp(5) == pytest.approx(0.5)
    video.show(5)
    assert video.forward()  # nothing is known there: no tracking
    assert video.results_at(6) == []
    go_to(video, 7)
    assert same(boxes(video, 9), plain(frames, {(0, 1): PERSON, (8, 1): TABLE}, 9))


def test_a_change_that_fails_changes_nothing(frames, monkeypatch):
    video, before = everything(frames, lambda video: None)
    video.show(3)
    objects, undo = video.objects, video.history.undo_change

    def refuse(*_, **__):
        raise ValueError("the tracker refuses this box")

    monkeypatch.setattr(MultiTracker, "add", refuse)
    for change in (
        lambda: video.add(THIRD),
        lambda: video.correct(1, THIRD),
        lambda: video.change(1, "table"),
        lambda: video.add(THIRD, "a\u202eb"),
    ):
        with pytest.raises(ValueError, match=r"refuses|another object|cannot be seen"):
            change()
    assert (video.objects, video.history.undo_change) == (objects, undo)
    monkeypatch.undo()

    def fail(*_, **__):
        raise RuntimeError("out of luck")

    go_to(video, 9)
    monkeypatch.setattr(MultiTracker, "update", fail)
    with pytest.raises(RuntimeError):
        video.forward()
    monkeypatch.undo()
    assert boxes(video) == before
    go_to(video, 11)
    assert same(boxes(video), plain(frames, {(0, 1): PERSON, (0, 2): TABLE}, 11))
