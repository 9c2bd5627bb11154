"""Objects as lists of key frames, and undo."""

import pytest

from re3.apps.server import annotation
from re3.apps.server.annotation import History, Segment, TrackedObject
from re3.apps.server.coverage import last_known_before, tracked_until, untracked, wanted
from re3.result import Result, Status

BOX = (1.0, 2.0, 3.0, 4.0)


def segment(start, until, goal=-1):
    results = [Result(BOX, 1.0, Status.TRACKED, at) for at in range(until - start + 1)]
    return Segment(start, BOX, results, goal)


def an_object(identity=1, **key_frames):
    """Key frames as `f4=8`: a box in frame 4, tracked to frame 8; `f4=None`: ended there."""
    frames = {int(name[1:]): until for name, until in key_frames.items()}
    made = {at: None if until is None else segment(at, until) for at, until in frames.items()}
    return TrackedObject(identity, f"o{identity}", "#ffffff", made)


@pytest.mark.parametrize(
    ("key_frames", "ranges", "gaps", "last"),
    [
        ({"f2": 9}, [(2, 9)], [], 9),  # one box
        ({"f2": 5}, [(2, 5)], [(6, 9)], 5),
        ({"f2": 9, "f4": 6}, [(2, 3), (4, 6)], [(7, 9)], 6),  # boxes hidden by the next one
        ({"f2": 3, "f6": 9}, [(2, 3), (6, 9)], [(4, 5)], 9),
        ({"f2": 9, "f5": None}, [(2, 4)], [], 5),  # ended
        ({"f2": 3, "f5": None}, [(2, 3)], [(4, 4)], 5),
        ({"f2": 9, "f5": None, "f7": 7}, [(2, 4), (7, 7)], [(8, 9)], 7),  # and drawn again
    ],
)
def test_what_is_known(key_frames, ranges, gaps, last):
    found = an_object(**key_frames)
    assert list(found.ranges()) == ranges
    assert list(found.gaps(9)) == gaps
    assert found.last_known == last
    known = {at for first, end in ranges for at in range(first, end + 1)}
    assert {at for at in range(12) if found.result_at(at)} == known
    assert all(found.is_known(at) for at in range(found.first))


def test_an_end_after_an_end_says_nothing():
    found = an_object(f2=9, f5=None, f8=9)
    assert found.with_key_frame(4, None).ends == [4]
    assert found.with_key_frame(6, None).ends == [5]
    assert found.without_key_frames_to(2).first == 8
    assert found.without_key_frames_to(8) is None


def test_coverage_of_several():
    objects = {1: an_object(1, f0=9), 2: an_object(2, f3=4, f7=7), 3: an_object(3, f0=9, f1=None)}
    assert tracked_until(objects) == 4
    assert last_known_before(objects, 9) == 7
    assert last_known_before(objects, 6) == 4
    assert untracked(objects, 10) == ["o1 in frame 10", "o2 in frames 5 to 6, 8 to 10"]
    assert tracked_until({}) is None
    goals = {1: TrackedObject(1, "a", "#000000", {0: segment(0, 2, 9), 5: segment(5, 5, 4)})}
    assert [(each.start, until) for each, until in wanted(goals)] == [(0, 4)]


def test_old_changes_are_forgotten(monkeypatch):
    history = History()
    for count in range(annotation.UNDO_STEPS + 20):
        history.make(str(count), 0, {1: an_object(f0=count)})
    undone = 0
    while history.undo():
        undone += 1
    assert undone == annotation.UNDO_STEPS
    monkeypatch.setattr(annotation, "RESULTS_KEPT", 100)
    for count in range(20):
        history.make(str(count), 0, {1: an_object(f0=29)})
    assert sum(len(each.results) for each in history.segments()) <= 100
    assert history.undo().what == "19"
    assert history.redo().what == "19"
    history.undo()
    history.make("other", 0, {})
    assert history.redo() is None
