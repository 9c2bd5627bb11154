"""Trackers in other processes, copied and pickled, and arguments that cannot be."""

import copy
import multiprocessing
import os
import pickle
import signal

import numpy as np
import pytest

import re3
from re3.engine import load_engine

BOX = (40.0, 30.0, 30.0, 24.0)


def frames(count, size=(96, 128)):
    rng = np.random.default_rng(0)
    background = rng.integers(0, 90, (*size, 3), dtype=np.uint8)
    for index in range(count):
        frame = background.copy()
        frame[30:54, 40 + index : 70 + index] = (60, 200, 240)
        yield frame


def started(objects=1, **options):
    multi = re3.MultiTracker("re3-lite", **options)
    first = next(frames(1))
    for place in range(objects):
        multi.add(first, (BOX[0] + place, *BOX[1:]))
    return multi


def boxes(multi, later):
    return {
        identity: result.box_xywh
        for frame in later
        for identity, result in multi.update(frame).items()
    }


@pytest.mark.skipif(not hasattr(os, "fork"), reason="takes no options: this system cannot fork")
@pytest.mark.parametrize("engine", ["onnx-int8", "onnx"])
def test_a_tracker_goes_on_after_a_fork(engine):
    multi = started(5, engine=engine, threads=2)
    later = list(frames(4))[1:]
    expected = boxes(copy.deepcopy(multi), later)
    receiver, sender = multiprocessing.Pipe(duplex=False)
    child = os.fork()
    if child == 0:  # only plain calls here: pytest must not go on in this process
        signal.alarm(60)  # ends it where it hangs
        try:
            sender.send(boxes(multi, later))
        finally:
            os._exit(0)
    found = receiver.recv() if receiver.poll(60) else None
    os.waitpid(child, 0)
    assert found is not None, "the forked process did not answer"
    for identity, box in expected.items():
        np.testing.assert_allclose(found[identity], box, atol=1e-3)
    again = boxes(multi, later)  # and the parent's goes on
    np.testing.assert_allclose(again[1], expected[1], atol=1e-3)


@pytest.mark.parametrize("change", [copy.deepcopy, lambda t: pickle.loads(pickle.dumps(t))])
def test_copies_go_on_by_themselves(change):
    tracker = re3.Tracker("re3-lite")
    first, *later = frames(5)
    tracker.init(first, BOX)
    tracker.update(later[0])
    other = change(tracker)
    for frame in later[1:]:
        np.testing.assert_allclose(
            other.update(frame).box_xywh, tracker.update(frame).box_xywh, atol=1e-3
        )


def test_a_tracker_of_an_engine_object_says_what_to_do():
    multi = re3.MultiTracker(engine=load_engine("re3-lite"))
    with pytest.raises(TypeError, match="save_state"):
        pickle.dumps(multi)


@pytest.mark.parametrize("threads", [1.5, "2", -1, True, None])
def test_threads_that_cannot_be(threads):
    for make in (re3.Tracker, re3.MultiTracker, load_engine):
        with pytest.raises(ValueError, match="threads is"):
            make("re3-lite", threads=threads)


@pytest.mark.parametrize(
    "box", [(10, 10, 1e200, 20), (10, 10, 20, 1e6), (-1e9, -1e9, 2e9, 2e9), (0, 0, 128 * 21, 9)]
)
def test_boxes_far_larger_than_the_frame(box):
    with pytest.raises(ValueError, match="as large as the frame"):
        re3.Tracker("re3-lite").init(next(frames(1)), box)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda array: np.full_like(array, np.inf), "infinity"),
        (lambda array: np.array([object()]), "Python objects"),
    ],
)
def test_states_that_no_tracker_has_saved(change, word):
    multi = started()
    saved = dict(multi.save_state())
    name = next(k for k, v in saved.items() if np.asarray(v).dtype.kind == "f")
    before = multi.results
    with pytest.raises(ValueError, match=word):
        multi.load_state({**saved, name: change(np.asarray(saved[name]))})
    assert multi.results.keys() == before.keys()
