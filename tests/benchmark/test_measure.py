"""Turns, percentiles and ratios, by a clock that only the contenders move."""

import numpy as np
import pytest

from re3.benchmark.contenders import Entry, our_entries
from re3.benchmark.footage import made_footage, read_footage
from re3.benchmark.measure import WARM_UP, Timing, over_rounds, take_turns
from re3.benchmark.memory import memory_of
from re3.benchmark.resident import peak_bytes, resident_bytes
from re3.timed_tracker import TimeSpent
from re3.video import VideoWriter

NAN = float("nan")


class Clock:
    now = 0.0


class Fake:
    """Takes `seconds` for an update of one object, and as much more for each other."""

    def __init__(self, clock, seconds, log, name, time_spent=None):
        self.clock, self.seconds, self.log, self.name = clock, seconds, log, name
        self.time_spent = time_spent or TimeSpent(NAN, NAN)
        self.seen = []

    def start(self, frame, boxes):
        self.log.append(self.name)
        self.objects = len(boxes)
        self.seen.clear()

    def update(self, frame):
        self.seen.append(int(frame[0, 0, 0]))
        self.clock.now += self.seconds * self.objects


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("re3.benchmark.measure.time.perf_counter", lambda: clock.now)
    return clock


def counted(count):
    """Footage whose frames carry their index."""
    made = made_footage(count)
    for index, frame in enumerate(made.frames):
        frame[0, 0, 0] = index
    return made


def test_contenders_take_turns_and_the_order_turns_with_them(clock):
    log = []
    told = TimeSpent(0.125, 0.25)
    contenders = {"a": Fake(clock, 1.0, log, "a", told), "b": Fake(clock, 3.0, log, "b")}
    found = take_turns(contenders, counted(3), objects=2, rounds=3, frames=4)
    assert log == ["a", "b", "b", "a", "a", "b"]
    np.testing.assert_array_equal(found["a"].update, np.full((3, 4), 2.0))
    assert found["a"].latency == found["b"].latency.__class__(2.0, 2.0, 2.0)
    assert found["a"].fps == 0.5
    assert found["a"].times_faster_than(found["b"]) == 3.0
    np.testing.assert_array_equal(found["a"].rest, np.full((3, 4), 1.625))
    assert np.isnan(found["b"].rest).all()


def test_frames_are_walked_to_and_fro_after_the_first(clock):
    fake = Fake(clock, 1.0, [], "a")
    take_turns({"a": fake}, counted(3), rounds=1, frames=5)
    assert fake.seen == [1, 2, 1, 0, 1, 2, 1]
    assert len(fake.seen) == WARM_UP + 5


def test_a_percentile_is_the_median_over_rounds():
    rounds = np.array([[1.0, 1.0, 3.0], [2.0, 2.0, 2.0], [9.0, 9.0, 9.0]])
    assert over_rounds(rounds).p50 == 2.0
    slow_round = Timing(1, np.array([[1.0], [100.0], [1.0]]), *2 * [np.zeros((3, 1))])
    other = Timing(1, np.array([[2.0], [200.0], [2.0]]), *2 * [np.zeros((3, 1))])
    assert slow_round.times_faster_than(other) == 2.0


def test_nothing_to_measure_is_refused():
    with pytest.raises(ValueError, match=r"0 contenders, 1 objects.*expected 1 or more"):
        take_turns({}, counted(2))


def test_made_frames_are_the_same_each_time_and_hold_the_object():
    first, second = made_footage(20), made_footage(20)
    x, y, w, h = (round(v) for v in first.box_xywh)
    for index, frame in enumerate(first.frames):
        np.testing.assert_array_equal(frame, second.frames[index])
        # The dark bar across the object's middle is somewhere in every frame.
        assert (frame == (30, 20, 20)).all(axis=2).sum() == 12 * w
    assert (first.frames[0][y + h // 2, x : x + w] == (30, 20, 20)).all()


def test_frames_of_a_source_are_scaled_with_their_box(tmp_path):
    path = tmp_path / "clip.mp4"
    with VideoWriter(path, 25, (320, 120)) as writer:
        for _ in range(5):
            writer.write(np.zeros((120, 320, 3), np.uint8))
    scaled = read_footage(str(path), (10, 20, 40, 30), 3)
    assert scaled.frames[0].shape == (480, 640, 3)
    assert len(scaled.frames) == 3
    assert scaled.box_xywh == (20, 80, 80, 120)
    assert read_footage(str(path), (10, 20, 40, 30), 3, None).box_xywh == (10, 20, 40, 30)
    with pytest.raises(ValueError, match="has 1 frame to measure on; expected 2"):
        read_footage(str(path), (10, 20, 40, 30), 1)


@pytest.mark.parametrize(
    ("models", "engines", "threads", "names"),
    [
        (["re3-lite"], ["auto"], [0], ["re3-lite"]),
        (["re3-lite"], ["auto"], [1], ["re3-lite 1t"]),
        (["re3-lite"], ["onnx", "torch"], [0], ["re3-lite onnx", "re3-lite torch"]),
        (["a/mine.onnx", "re3-lite"], ["auto"], [0], ["mine", "re3-lite"]),
    ],
)
def test_names_say_what_differs(models, engines, threads, names):
    assert [entry.name for entry in our_entries(models, engines, threads)] == names


def test_memory_is_that_of_a_process_of_its_own():
    held = np.ones(60_000_000, np.uint8)  # here, not there
    memory = memory_of(Entry("mosse", False, "mosse"))
    assert 20e6 < memory.before <= memory.peak
    assert memory.resident <= memory.peak
    assert memory.resident < resident_bytes() + held.nbytes
    assert peak_bytes() >= resident_bytes() > held.nbytes


def test_sizes_are_those_of_the_model_files():
    from re3.models import find_eight_bits, find_weights

    assert Entry("a", True, "re3-lite").size_bytes == find_eight_bits("re3-lite").stat().st_size
    full = Entry("b", True, "re3-lite", engine="onnx")
    assert full.size_bytes == find_weights("re3-lite").stat().st_size
    assert Entry("csrt", False, "csrt").size_bytes == 0
