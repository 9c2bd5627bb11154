"""Converters to OpenCV and supervision, and the tracker with OpenCV's interface."""

import math
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import re3
from re3.interop import from_detections, from_rect, to_detections, to_rect
from re3.result import Result, Status
from re3.video import open_source

CLIP = Path(__file__).parents[1] / "examples" / "clips" / "person.mp4"
PERSON = (368, 58, 158, 374)


@pytest.fixture(scope="module")
def frames():
    with open_source(CLIP) as source:
        return [frame.image for frame, _ in zip(source, range(4), strict=False)]


def result(box=(10.0, 20.0, 30.0, 40.0), **changes):
    fields = {"score": 0.75, "status": Status.TRACKED, "frame_index": 7, "object_id": 3}
    return Result(box_xywh=box, **{**fields, **changes})


@pytest.mark.parametrize(
    ("box", "rect"),
    [
        ((10.0, 20.0, 30.0, 40.0), (10, 20, 30, 40)),
        ((10.4, 20.4, 30.4, 40.4), (10, 20, 31, 41)),  # the right edge at 40.8 goes to 41
        ((-5.6, 0.2, 3.0, 3.0), (-6, 0, 3, 3)),  # outside the frame
        ((4.6, 4.6, 0.2, 0.2), (5, 5, 1, 1)),  # never without area
    ],
)
def test_rectangles_have_whole_pixels(box, rect):
    assert to_rect(box) == to_rect(result(box)) == rect
    assert {type(value) for value in to_rect(box)} == {int}


def test_neighbours_stay_neighbours():
    left, right = to_rect((0.0, 0.0, 10.5, 4.0)), to_rect((10.5, 0.0, 10.0, 4.0))
    assert left[0] + left[2] == right[0]


def test_opencv_draws_the_rectangle_where_the_box_is():
    image = np.zeros((80, 80), np.uint8)
    cv2.rectangle(image, to_rect(result()), 255, cv2.FILLED)
    assert cv2.boundingRect(image) == (10, 20, 30, 40)
    assert from_rect(cv2.boundingRect(image)) == result().box_xywh


@pytest.mark.parametrize("box", [(1, 2, 3), (1, 2, math.nan, 4), (1, 2, math.inf, 4)])
def test_what_is_no_box_gives_no_rectangle(box):
    with pytest.raises(ValueError, match=r"expected|finite"):
        to_rect(box)


def test_a_cancelled_selection_is_an_error():
    with pytest.raises(ValueError, match="selectROI returns zeros when it was cancelled"):
        from_rect((0, 0, 0, 0))
    with pytest.raises(ValueError, match=r"shape \(3,\)"):
        from_rect((1, 2, 3))


def test_the_tracker_answers_as_opencvs_does(frames):
    theirs, ours = cv2.TrackerCSRT.create(), re3.TrackerRe3.create()
    assert ours.init(frames[0], PERSON) is theirs.init(frames[0], PERSON) is None
    for frame in frames[1:]:
        (found, box), (other_found, other_box) = ours.update(frame), theirs.update(frame)
        assert type(found) is type(other_found) is bool
        assert type(box) is type(other_box) is tuple
        assert [type(v) for v in box] == [type(v) for v in other_box] == [int] * 4
        assert found is other_found is True
    # Both follow the same person.
    assert re3.geometry.iou_xywh(box, other_box) > 0.5


def test_the_tracker_takes_the_arguments_by_opencvs_names(frames):
    for tracker in (cv2.TrackerCSRT.create(), re3.TrackerRe3.create()):
        tracker.init(image=frames[0], boundingBox=PERSON)
        assert tracker.update(image=frames[1])[0]


def test_a_lost_object_is_answered_as_opencv_does(frames):
    theirs, ours = cv2.TrackerCSRT.create(), re3.TrackerRe3.create()
    black = np.zeros_like(frames[0])
    for tracker in (theirs, ours):
        tracker.init(frames[0], PERSON)
        tracker.update(frames[1])
    answers = [(ours.update(black), theirs.update(black)) for _ in range(3)]
    assert answers[-1][0] == answers[-1][1] == (False, (0, 0, 0, 0))
    # Neither has given up.
    assert type(ours.update(frames[2])) is type(theirs.update(frames[2])) is tuple


def test_the_tracker_finds_what_ours_finds(frames):
    adapter, tracker = re3.TrackerRe3.create(), re3.Tracker()
    assert adapter.getTrackingScore() == 0
    adapter.init(frames[0], PERSON)
    assert adapter.getTrackingScore() == tracker.init(frames[0], PERSON).score == 1
    for frame in frames[1:]:
        expected = tracker.update(frame)
        assert adapter.update(frame) == (True, to_rect(expected))
        assert adapter.getTrackingScore() == expected.score


def test_mistakes_are_errors_with_both(frames):
    for create, error in (
        (cv2.TrackerCSRT.create, cv2.error),
        (re3.TrackerRe3.create, (ValueError, RuntimeError)),
    ):
        with pytest.raises(error):
            create().update(frames[0])
        with pytest.raises(error):
            create().init(frames[0], (368, 58, 0, 0))
        with pytest.raises(error):
            create().init(frames[0], (5000, 5000, 10, 10))


def test_results_survive_a_round_trip_through_supervision():
    pytest.importorskip("supervision", reason="needs supervision, which re3 does not require")
    given = [
        result(name="car"),
        result((-3.5, 1.25, 8.0, 9.0), object_id=4, score=0.25, status=Status.LOST),
    ]
    detections = to_detections(given)
    np.testing.assert_array_equal(detections.xyxy[0], [10, 20, 40, 60])
    assert detections.tracker_id.tolist() == [3, 4]
    assert detections.data["class_name"].tolist() == ["car", "4"]
    assert from_detections(detections) == given


def test_supervision_can_filter_and_draw_them():
    supervision = pytest.importorskip("supervision", reason="needs supervision")
    detections = to_detections([result(name="car"), result(object_id=9, score=0.1)])
    (sure,) = from_detections(detections[detections.confidence > 0.5])
    assert sure.name == "car"
    image = np.zeros((80, 80, 3), np.uint8)
    drawn = supervision.BoxAnnotator(thickness=1).annotate(image.copy(), detections[:1])
    rows, columns = np.nonzero(drawn.any(axis=2))
    assert (columns.min(), rows.min(), columns.max(), rows.max()) == (10, 20, 40, 60)
    assert supervision.LabelAnnotator().annotate(image.copy(), detections).any()


def test_no_results_are_no_detections():
    pytest.importorskip("supervision", reason="needs supervision")
    assert len(to_detections([])) == 0
    assert from_detections(to_detections([])) == []


def test_a_detectors_boxes_start_tracks(frames):
    supervision = pytest.importorskip("supervision", reason="needs supervision")
    x, y, w, h = PERSON
    detections = supervision.Detections(
        xyxy=np.array([[x, y, x + w, y + h]], np.float32),
        confidence=np.array([0.3], np.float32),
        class_id=np.array([0]),
        data={"class_name": np.array(["person"])},
    )
    (found,) = from_detections(detections)
    # A detector's confidence is no overlap: it makes nothing LOST.
    assert (found.status, found.name, found.object_id) == (Status.TRACKED, "person", 1)
    multi = re3.MultiTracker()
    identity = multi.add(frames[0], found.box_xywh, found.name)
    assert multi.update(frames[1])[identity].name == "person"


def test_boxes_alone_are_enough():
    supervision = pytest.importorskip("supervision", reason="needs supervision")
    found = from_detections(supervision.Detections(xyxy=np.array([[1.0, 2, 4, 6], [0, 0, 1, 1]])))
    assert [(each.object_id, each.name) for each in found] == [(1, None), (2, None)]
    assert math.isnan(found[0].score)
    assert found[0].box_xywh == (1, 2, 3, 4)


def test_supervision_is_imported_only_when_it_is_used():
    code = "import sys, re3; print('supervision' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "False"


def test_without_supervision_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "supervision", None)
    with pytest.raises(ImportError, match="pip install 'supervision"):
        to_detections([])
