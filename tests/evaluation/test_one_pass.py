import itertools

import numpy as np
import pytest

from re3.evaluation import one_pass
from re3.evaluation.one_pass import (
    Latency,
    Track,
    decode_time,
    frames_per_second,
    latency,
    run_one_pass,
)

NAN = (np.nan,) * 4
BOXES = [(0, 0, 2, 2), (1, 0, 2, 2), (2, 0, 2, 2), (3, 0, 2, 2)]


class Scripted:
    """Says what it is told to; an exception is raised. Remembers what it was given."""

    def __init__(self, *answers, at_start=None):
        self.answers = list(answers)
        self.at_start = at_start
        self.seen = []

    def init(self, frame, box_xywh):
        self.seen.append(("init", int(frame[0, 0, 0]), tuple(box_xywh)))
        if self.at_start is not None:
            raise self.at_start

    def update(self, frame):
        self.seen.append(("update", int(frame[0, 0, 0])))
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


def test_it_starts_once_and_follows_to_the_end(sequence_of):
    tracker = Scripted(((9, 9, 1, 1), 0.1), ((8, 8, 1, 1), 0.9), (np.array([7, 7, 1, 1]), 0.5))
    done = []
    track = run_one_pass(lambda: tracker, sequence_of(BOXES), done.append)
    # However far off it is, it is not started again.
    assert tracker.seen == [("init", 0, BOXES[0]), ("update", 1), ("update", 2), ("update", 3)]
    assert track.boxes_xywh.tolist() == [[0, 0, 2, 2], [9, 9, 1, 1], [8, 8, 1, 1], [7, 7, 1, 1]]
    assert track.scores.tolist() == [1.0, 0.1, 0.9, 0.5]
    assert (track.seconds > 0).all()
    assert track.failure is None
    assert done == [1, 2, 3, 4]


def test_it_starts_at_the_first_annotated_frame(sequence_of):
    tracker = Scripted(((9, 9, 1, 1), 0.1))
    track = run_one_pass(lambda: tracker, sequence_of([NAN, NAN, BOXES[2], NAN]))
    assert tracker.seen == [("init", 2, BOXES[2]), ("update", 3)]
    np.testing.assert_array_equal(track.boxes_xywh, [NAN, NAN, BOXES[2], (9, 9, 1, 1)])
    assert np.isnan(track.seconds).tolist() == [True, True, False, False]


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (RuntimeError("out of\n  memory"), "frame 2: update raised RuntimeError: out of memory"),
        (((1, 2, np.nan, 4), 0.5), "frame 2: update gave"),  # not finite
        (((1, 2, np.inf, 4), 0.5), "frame 2: update gave"),
        (((1, 2, 3), 0.5), "frame 2: update gave"),  # not four
        ((None, 0.5), "frame 2: update gave None"),
        ((("a", "b", "c", "d"), 0.5), "frame 2: update gave"),
        (((1, 2, 3, 4), None), "frame 2: update gave"),  # no score
        (5, "frame 2: update raised TypeError"),  # not a pair
    ],
)
def test_a_failure_ends_the_track_and_says_why(sequence_of, answer, told):
    track = run_one_pass(lambda: Scripted(((1, 1, 2, 2), 0.7), answer), sequence_of(BOXES))
    assert track.failure is not None and track.failure.startswith(told)
    np.testing.assert_array_equal(track.boxes_xywh, [BOXES[0], (1, 1, 2, 2), NAN, NAN])
    assert np.isnan(track.scores).tolist() == [False, False, True, True]


def test_a_tracker_that_cannot_start_has_no_box_at_all(sequence_of):
    tracker = Scripted(at_start=ValueError("too small"))
    track = run_one_pass(lambda: tracker, sequence_of(BOXES))
    assert track.failure == "frame 0: init raised ValueError: too small"
    assert np.isnan(track.boxes_xywh).all()
    assert track.update_seconds.size == 0


def test_a_sequence_without_truth_is_refused(sequence_of):
    with pytest.raises(ValueError, match="'clip' has no annotated frame"):
        run_one_pass(Scripted, sequence_of([NAN, NAN]))


def test_what_a_factory_raises_is_not_the_tracker_failing(sequence_of):
    def factory():
        raise FileNotFoundError("no weights")

    with pytest.raises(FileNotFoundError, match="no weights"):
        run_one_pass(factory, sequence_of(BOXES))


def test_times_are_those_of_the_tracker(sequence_of, monkeypatch):
    # 0, 1, 3, 6, 10, ...: from each look at the clock to the next a second longer.
    ticks = itertools.accumulate(range(100))
    monkeypatch.setattr(one_pass.time, "perf_counter", lambda: float(next(ticks)))
    track = run_one_pass(lambda: Scripted(*[((1, 1, 2, 2), 0.7)] * 3), sequence_of(BOXES))
    assert track.decode_seconds.tolist() == [1, 5, 9, 13]
    assert track.seconds.tolist() == [3, 7, 11, 15]
    assert track.update_seconds.tolist() == [7, 11, 15]
    assert decode_time([track]) == 7


def test_latency_is_told_in_percentiles():
    seconds = np.array([99.0, *range(1, 102), np.nan])
    track = Track(np.zeros((103, 4)), np.ones(103), seconds)
    assert track.latency == Latency(p50=51, p95=96, p99=100)
    assert np.isnan(latency([]).p99)
    assert np.isnan(decode_time([track]))


def test_a_tracker_is_closed_however_it_ends(sequence_of):
    closed = []

    class Closing(Scripted):
        def close(self):
            closed.append(1)
            raise OSError("gone already")

    answers = ((1, 1, 2, 2), 0.7)
    run_one_pass(lambda: Closing(*[answers] * 3), sequence_of(BOXES))
    run_one_pass(lambda: Closing(RuntimeError("no")), sequence_of(BOXES))
    assert closed == [1, 1]


@pytest.mark.parametrize(
    ("seconds", "fps"),
    [
        ([[9.0, 0.1, 0.1, 0.3]], 6.0),  # three updates in half a second; the start is left out
        # Nine of ten updates do nothing: the median would say a million.
        ([[9.0, 0.999991, *[1e-6] * 9]], 10.0),
        ([[9.0, 0.1], [9.0, 0.2, 0.3]], 5.0),  # over all frames of all tracks
        ([[np.nan, 9.0, 0.5, np.nan]], 2.0),  # frames without the tracker are left out
        ([[9.0]], np.nan),  # no update
        ([], np.nan),
    ],
)
def test_frames_per_second(seconds, fps):
    tracks = [Track(np.zeros((len(s), 4)), np.ones(len(s)), np.array(s)) for s in seconds]
    np.testing.assert_allclose(frames_per_second(tracks), fps)
