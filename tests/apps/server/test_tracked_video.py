"""Stepping, going back, correcting: what comes out depends on the boxes given alone."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.states import SavedState, StateStore
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
    return TrackedVideo(video, MultiTracker(engine=ENGINE), Limits(**limits), StateStore(budget))


def go_to(video, index):
    video.show(video.last_shown_before(index))
    while video.position < index:
        assert video.forward()


def boxes(video, until=FRAMES - 1):
    return {
        index: {result.object_id: (result.box_xywh, result.score) for result in results}
        for index in range(until + 1)
        if (results := video.results_at(index))
    }


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
    assert boxes(video) == plain(frames, {(0, 1): PERSON})


def test_a_correction_far_back_makes_the_rest_be_tracked_again(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    go_to(video, 10)
    video.show(4)
    video.correct(1, TABLE)
    assert video.tracked_until == 4
    go_to(video, 10)
    assert boxes(video) == plain(frames, {(0, 1): PERSON, (4, 1): TABLE}, 10)


def test_a_correction_stays_when_something_earlier_changes(frames):
    video = tracked_video(frames)
    video.add(PERSON)
    go_to(video, 8)
    video.correct(1, TABLE)
    video.show(3)
    video.add(TABLE, "table")
    go_to(video, 10)
    assert boxes(video) == plain(frames, {(0, 1): PERSON, (3, 2): TABLE, (8, 1): TABLE}, 10)


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
    assert boxes(video) == plain(frames, given, 11)


def test_an_object_may_begin_later_and_another_before_it(frames):
    video = tracked_video(frames)
    go_to(video, 6)
    assert video.tracked_until is None
    video.add(PERSON)
    go_to(video, 8)
    video.show(2)
    video.add(TABLE)
    go_to(video, 8)
    assert boxes(video) == plain(frames, {(6, 1): PERSON, (2, 2): TABLE}, 8)


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
    assert min(video.tracked) == 3
    video.remove(3)
    assert video.tracked == {}
    video.show(0)
    go_to(video, 9)
    assert video.tracked == {}


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
    assert len(video.tracked) == 5
    video.show(2)
    video.correct(1, PERSON)
    go_to(video, 4)


def test_a_video_without_frames_is_refused():
    with pytest.raises(SourceError, match="no frame"):
        tracked_video(Frames(0))


def test_states_are_thinned_out_evenly():
    store = StateStore(budget=60 * 800)
    for frame in range(400):
        store.put(frame, SavedState({"a": np.full(100, frame, np.float64)}, {}))
    assert 30 < len(store) <= 61
    for frame in (399, 390, 376):
        assert store.nearest(frame)[0] == frame
    assert all(frame - store.nearest(frame)[0] <= 32 for frame in range(400))
    store.drop_after(100)
    assert store.nearest(399)[0] <= 100
    assert store.nearest(399)[1].arrays["a"][0] == store.nearest(399)[0]
    assert StateStore().nearest(5) is None
