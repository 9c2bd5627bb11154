"""Trackers of other processes over TraX."""

import importlib
import importlib.util
import shlex
import sys
import time

import numpy as np
import pytest

from re3.evaluation.one_pass import run_one_pass
from re3.evaluation.opencv_trackers import medianflow
from re3.evaluation.trax import TraxTracker, import_trax

needs_trax = pytest.mark.skipif(
    importlib.util.find_spec("trax") is None,
    reason="needs the package vot-trax: pip install 're3[vot]'",
)

# A tracker that says what it was sent: the first pixel as RGB, and how often it was started.
SERVER = """
import sys, time
import cv2
import numpy as np
from trax import Image, Mask, Polygon, Rectangle, Region, Server, Special, TraxStatus

transport, region, behaviour = sys.argv[1:4]
starts = 0
with Server([region], [transport], ["color"], tracker_name="echo") as server:
    while True:
        request = server.wait()
        if request.type == TraxStatus.QUIT:
            break
        image = request.image["color"]
        if transport == "path":
            pixel = cv2.imread(image.path())[0, 0, ::-1]
        elif transport == "buffer":
            pixel = cv2.imdecode(np.frombuffer(image.buffer(), np.uint8), 1)[0, 0, ::-1]
        else:
            pixel = image.array()[0, 0]
        if request.type == TraxStatus.INITIALIZE:
            starts += 1
            given = request.objects[0][0]
            server.status([(given, {})])
            continue
        if behaviour == "hang":
            time.sleep(60)
        if behaviour == "crash":
            print("out of ideas", flush=True)
            sys.exit(3)
        properties = {}
        if behaviour.startswith("confidence="):
            properties["confidence"] = behaviour.partition("=")[2]
        answer = Rectangle.create(*(float(v) for v in pixel), float(starts))
        if behaviour == "given":
            answer = given
        if behaviour == "special":
            answer = Special.create(0)
        if behaviour == "mask":
            mask = np.zeros((6, 8), np.uint8)
            mask[1:4, 2:7] = 1
            answer = Mask.create(mask, x=10, y=20)
        server.status([(answer, properties)])
"""

BOX = (30.0, 20.0, 40.0, 32.0)


@pytest.fixture
def echo(tmp_path):
    """Start the tracker above."""
    script = tmp_path / "a tracker.py"
    script.write_text(SERVER)
    started = []

    def start(transport="memory", region="rectangle", behaviour="", timeout=30.0):
        command = [sys.executable, str(script), transport, region, behaviour]
        started.append(TraxTracker(command, timeout))
        return started[-1]

    yield start
    for tracker in started:
        tracker.close()


def frame(*bgr):
    return np.full((24, 32, 3), bgr, np.uint8)


def ours(tracker):
    return shlex.join([sys.executable, "-m", "re3.apps.trax_server", "--tracker", tracker])


@needs_trax
def test_our_server_gives_what_the_tracker_gives(sequence_of, moving_patch):
    images, boxes = moving_patch
    alone, expected = medianflow(), []
    alone.init(images[0], BOX)
    with TraxTracker(ours("medianflow")) as tracker:
        assert tracker.name == "medianflow"
        tracker.init(images[0], BOX)
        for image in images[1:]:
            box, score = tracker.update(image)
            expected.append(alone.update(image)[0])
            # TraX sends numbers as text of four decimals.
            assert box == pytest.approx(expected[-1], abs=1e-3)
            assert score == 1.0
        # Started again, it is a fresh tracker in the same process.
        tracker.init(images[0], BOX)
        assert tracker.update(images[1])[0] == pytest.approx(expected[0], abs=1e-3)
    assert np.abs(np.array(expected[-1]) - boxes[-1]).max() < 8


@needs_trax
@pytest.mark.parametrize("transport", ["path", "memory", "buffer"])
def test_frames_arrive_as_they_are(echo, transport):
    tracker = echo(transport)
    tracker.init(frame(0, 0, 0), BOX)
    assert tracker.update(frame(1, 20, 255)) == ((255, 20, 1, 1), 1.0)
    assert tracker.update(frame(7, 8, 9)) == ((9, 8, 7, 1), 1.0)
    tracker.init(frame(0, 0, 0), BOX)
    assert tracker.update(frame(7, 8, 9)) == ((9, 8, 7, 2), 1.0)


@needs_trax
@pytest.mark.parametrize("region", ["rectangle", "polygon"])
def test_the_box_arrives_as_the_region_the_tracker_takes(echo, region):
    tracker = echo(region=region, behaviour="given")
    tracker.init(frame(0, 0, 0), (1.25, 2.5, 3, 4.75))
    assert tracker.update(frame(0, 0, 0))[0] == (1.25, 2.5, 3, 4.75)


@needs_trax
def test_the_box_of_a_mask_is_around_it(echo):
    tracker = echo(behaviour="mask")
    tracker.init(frame(0, 0, 0), BOX)
    assert tracker.update(frame(0, 0, 0))[0] == (12, 21, 5, 3)


@needs_trax
@pytest.mark.parametrize(
    ("given", "score"),
    [("0.25", 0.25), ("17", 1.0), ("-0.5", 0.0), ("nan", 1.0), ("high", 1.0)],
)
def test_confidence_is_the_score(echo, given, score):
    tracker = echo(behaviour=f"confidence={given}")
    tracker.init(frame(0, 0, 0), BOX)
    assert tracker.update(frame(0, 0, 0))[1] == score


@needs_trax
@pytest.mark.parametrize(
    ("behaviour", "told"),
    [
        ("crash", "out of ideas"),
        ("special", "has no box"),
        ("hang", "did not answer within 2 s and was ended"),
    ],
)
def test_a_tracker_that_fails_says_why(echo, behaviour, told):
    tracker = echo(behaviour=behaviour, timeout=2.0)
    tracker.init(frame(0, 0, 0), BOX)
    with pytest.raises(RuntimeError, match=told):
        tracker.update(frame(0, 0, 0))
    if behaviour != "special":
        with pytest.raises(RuntimeError, match="not running any more"):
            tracker.update(frame(0, 0, 0))


@needs_trax
def test_a_failure_of_the_tracker_ends_the_track_alone(sequence_of, echo):
    sequence = sequence_of([BOX] * 4)
    track = run_one_pass(lambda: echo(behaviour="crash"), sequence)
    assert "out of ideas" in track.failure
    assert np.isfinite(track.boxes_xywh[0]).all()
    assert np.isnan(track.boxes_xywh[1:]).all()


@needs_trax
@pytest.mark.parametrize(
    ("command", "error", "told"),
    [
        ("", ValueError, "no command"),
        ([sys.executable, "-c", "print('hello')"], RuntimeError, "it printed: hello"),
        ([sys.executable, "-c", "input(); input()"], RuntimeError, "did not answer within 2 s"),
        (["/no/such/tracker"], FileNotFoundError, "/no/such/tracker"),
        (ours("kfc"), RuntimeError, "no tracker is called 'kfc'"),
    ],
)
def test_what_does_not_speak_trax_is_told(command, error, told):
    with pytest.raises(error, match=told):
        TraxTracker(command, timeout=2.0 if "input" in str(command) else 30.0)


@needs_trax
def test_a_tracker_of_other_images_or_regions_is_refused(echo):
    with pytest.raises(RuntimeError, match="takes images as url; expected one of memory"):
        echo("url")
    with pytest.raises(RuntimeError, match="takes objects as mask; expected rectangle or polygon"):
        echo(region="mask")


@needs_trax
def test_closing_ends_the_process(echo):
    tracker = echo()
    began = time.monotonic()
    tracker.close()
    tracker.close()
    assert tracker._process.returncode == 0
    assert time.monotonic() - began < 2


def test_a_timeout_is_above_0():
    if importlib.util.find_spec("trax") is None:
        pytest.skip("needs the package vot-trax: pip install 're3[vot]'")
    with pytest.raises(ValueError, match="timeout is 0"):
        TraxTracker("true", timeout=0)


def test_without_the_package_the_error_names_the_extra(monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 're3\[vot\]'"):
        import_trax()
