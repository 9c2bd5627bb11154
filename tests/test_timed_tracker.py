"""The tracker with a clock: the same boxes, and where the time went."""

import itertools
import math

import numpy as np
import pytest

from re3 import geometry
from re3.engine import StepOutput
from re3.model_spec import CropSpec, ModelSpec
from re3.timed_tracker import TimedMultiTracker, TimeSpent, time_spent
from re3.tracker import MultiTracker

VIEW = CropSpec(context=2.0, size=16)
BOX = (40.0, 30.0, 24.0, 20.0)


class Engine:
    """Follows the mean of the crop; takes four seconds of a clock for a step."""

    def __init__(self, previous=None, clock=None):
        self.spec = ModelSpec("made", previous, VIEW, (127.0,) * 3, {"count": (1,)})
        self.clock = clock

    def step(self, previous_crops, current_crops, state):
        if self.clock is not None:
            self.clock.now += 4
        middle = 5 + (current_crops.mean(axis=(1, 2, 3)) - 127) / 100
        corners = np.stack([middle - 2.5, middle - 2.5, middle + 2.5, middle + 2.5], axis=1)
        score = np.full(len(corners), 0.9, np.float32)
        return StepOutput(corners.astype(np.float32), score, {"count": state["count"] + 1})


class Clock:
    now = 0.0


@pytest.fixture
def clock(monkeypatch):
    """A clock that only a step, four seconds, and a crop, one, move on."""
    clock = Clock()
    crop = geometry.crop

    def slow_crop(*arguments):
        clock.now += 1
        return crop(*arguments)

    monkeypatch.setattr(geometry, "crop", slow_crop)
    monkeypatch.setattr("re3.timed_tracker.time.perf_counter", lambda: clock.now)
    return clock


def noise(seed):
    return np.random.default_rng(seed).integers(0, 256, (100, 140, 3), dtype=np.uint8)


@pytest.mark.parametrize("previous", [None, CropSpec(context=2.0, size=32)])
def test_the_clock_changes_no_box(previous):
    plain, timed = (kind(engine=Engine(previous)) for kind in (MultiTracker, TimedMultiTracker))
    for tracker in (plain, timed):
        tracker.add(noise(0), BOX)
        tracker.add(noise(0), (80, 60, 30, 30), "second")
    for seed in range(1, 5):
        assert timed.update(noise(seed)) == plain.update(noise(seed))
    saved = timed.save_state()
    assert saved.keys() == plain.save_state().keys()
    assert saved["model"] == "made"


@pytest.mark.parametrize(
    ("previous", "objects", "start", "update"),
    [
        (None, 1, (5, 8), (1, 4)),  # one crop a frame; the start has four looks more
        (VIEW, 1, (2, 4), (2, 4)),  # that of the frame before is cut as well
        (None, 3, (5, 8), (3, 4)),  # a crop each, one step for all
    ],
)
def test_each_call_tells_of_its_own_time(clock, previous, objects, start, update):
    tracker = TimedMultiTracker(engine=Engine(previous, clock))
    assert tracker.time_spent == (0, 0)
    for _ in range(objects):
        tracker.add(noise(0), BOX)
        assert tracker.time_spent == start
    for seed in (1, 2):
        tracker.update(noise(seed))
        assert tracker.time_spent == update
    for identity in list(tracker.results):
        tracker.remove(identity)
    tracker.update(noise(3))
    assert tracker.time_spent == TimeSpent(crop_seconds=0, network_seconds=0)


@pytest.mark.parametrize(
    "tracker",
    [
        object(),
        type("Other", (), {"time_spent": 3.0})(),  # something else of that name
        type("Pair", (), {"time_spent": (1.0, 2.0)})(),
    ],
)
def test_a_tracker_that_does_not_tell_has_no_times(tracker):
    assert all(map(math.isnan, time_spent(tracker)))


def test_the_clock_is_looked_at_twice_a_crop_and_twice_a_step(monkeypatch):
    looks = itertools.count()
    monkeypatch.setattr("re3.timed_tracker.time.perf_counter", lambda: float(next(looks)))
    tracker = TimedMultiTracker(engine=Engine())
    tracker.add(noise(0), BOX)
    before = next(looks)
    tracker.update(noise(1))
    assert next(looks) - before - 1 == 4
