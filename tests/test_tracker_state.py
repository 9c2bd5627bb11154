"""States of objects, split and joined: tracking goes on as if nothing had happened."""

import numpy as np
import pytest

from re3 import MultiTracker
from re3.engine import load_engine
from re3.tracker_state import join_states, split_state

BOXES = ((20.0, 30.0, 40.0, 50.0), (90.0, 20.0, 30.0, 60.0), (60.0, 60.0, 50.0, 30.0))


@pytest.fixture(scope="module")
def engine():
    return load_engine("re3-lite")


@pytest.fixture(scope="module")
def frames():
    image = np.random.default_rng(3).integers(0, 255, (12, 16, 3), np.uint8)
    large = image.repeat(10, 0).repeat(10, 1)
    return [np.roll(large, 2 * index, 1) for index in range(6)]


def started(engine, frames):
    tracker = MultiTracker(engine=engine)
    for box in BOXES:
        tracker.add(frames[0], box)
    for frame in frames[1:3]:
        tracker.update(frame)
    return tracker


def go_on(tracker, frames):
    for frame in frames[3:]:
        tracker.update(frame)
    return [(result.box_xywh, result.score, result.status) for result in tracker.results.values()]


@pytest.mark.parametrize("ids", [(1, 2, 3), (3, 1), (2,)])
def test_joined_states_track_as_before(engine, frames, ids):
    tracker = started(engine, frames)
    states = split_state(tracker.save_state())
    assert list(states) == [1, 2, 3]
    other = MultiTracker(engine=engine)
    other.load_state(join_states([states[each] for each in ids]))
    assert list(other.results) == list(range(1, len(ids) + 1))
    expected = go_on(tracker, frames)
    for (box, score, status), identity in zip(go_on(other, frames), ids, strict=True):
        assert box == pytest.approx(expected[identity - 1][0], abs=1e-4)
        assert score == pytest.approx(expected[identity - 1][1], abs=1e-5)
        assert status == expected[identity - 1][2]
    assert other.add(frames[-1], BOXES[0]) == len(ids) + 1


def test_a_tracker_without_objects_has_no_states(engine):
    assert split_state(MultiTracker(engine=engine).save_state()) == {}
