"""Where labelling starts: moving regions, salient ones, what moves with the camera."""

import cv2
import numpy as np
import pytest
import stub_trackers as stubs

from re3.geometry import iou_xywh
from re3.labelling.regions import Motion, boxes_of_mask, relative_motion, salient_regions
from re3.labelling.videos import LEAST_OWN_MOTION


def panning(count=24, camera=1, speed=3):
    """A camera that moves over a wide ground, and a square that moves otherwise."""
    wide = stubs.ground(3, (96, 320))
    frames, boxes = [], []
    for t in range(count):
        frame = wide[:, camera * t : camera * t + 160].copy()
        box = np.array([10.0 + (speed - camera) * t, 30, 30, 30])
        stubs.paint(frame, box)
        frames.append(frame)
        boxes.append(box)
    return frames, np.array(boxes)


@pytest.mark.parametrize("frame", [6, 20, 33])
def test_before_a_still_camera_what_moves_is_found_as_a_whole(frame):
    motion = Motion(stubs.footage())
    assert motion.foreground is not None
    (region,) = motion.regions(frame)
    assert region.frame == frame
    assert iou_xywh(region.box_xywh, stubs.square(frame)) > 0.7
    assert motion.foreground_share(frame, stubs.square(frame)) > 0.9
    assert motion.foreground_share(frame, np.array([10.0, 70, 24, 20])) < 0.1


def test_boxes_are_in_pixels_of_the_frame_not_of_the_thumbnail():
    large = [cv2.resize(frame, None, fx=3, fy=3) for frame in stubs.footage()]
    (region,) = Motion(large).regions(20)
    assert iou_xywh(region.box_xywh, 3 * stubs.square(20)) > 0.7


def test_before_a_moving_camera_the_motion_of_the_ground_does_not_count():
    frames, boxes = panning()
    motion = Motion(frames)
    assert motion.foreground is None
    assert motion.foreground_share(0, boxes[0]) == 1.0
    region = motion.regions(12)[0]
    assert iou_xywh(region.box_xywh, boxes[12]) > 0.2
    assert motion.own(boxes) > LEAST_OWN_MOTION
    ground = np.array([[100.0 - t, 66, 30, 25] for t in range(24)])
    assert motion.own(ground) < LEAST_OWN_MOTION
    assert motion.own(np.full((24, 4), np.nan)) == 0.0


def test_the_last_frame_has_regions_as_well():
    frames, boxes = panning()
    assert iou_xywh(Motion(frames).regions(23)[0].box_xywh, boxes[22]) > 0.2


def test_of_a_still_picture_nothing_moves_but_something_stands_out():
    frame = np.full((120, 160, 3), 90, np.uint8)
    frame[40:70, 60:90] = np.random.default_rng(0).integers(0, 255, (30, 30, 1))
    assert Motion([frame] * 24).regions(3) == []
    region = salient_regions(frame, 7)[0]
    assert region.frame == 7
    assert iou_xywh(region.box_xywh, (60, 40, 30, 30)) > 0.3


def test_motion_is_relative_to_the_camera():
    ground = stubs.ground(2, (100, 170))[..., 0]
    still = relative_motion(ground[:96, :160], ground[:96, 3:163])  # 3 px to the left
    assert np.median(still) < 0.3


@pytest.mark.parametrize(
    ("x", "y", "width", "height", "found"),
    [
        (20, 30, 40, 30, True),
        (20, 30, 5, 4, False),  # 20 of 10,000 pixels
        (0, 0, 90, 80, False),  # most of the frame
        (10, 10, 80, 10, False),  # 8 to 1
    ],
)
def test_regions_have_the_size_and_shape_of_objects(x, y, width, height, found):
    mask = np.zeros((100, 100), bool)
    mask[y : y + height, x : x + width] = True
    boxes = boxes_of_mask(mask, np.ones((100, 100)))
    assert [box.tolist() for box, _ in boxes] == ([[x, y, width, height]] if found else [])


def test_strong_regions_come_first():
    mask = np.zeros((100, 100), bool)
    mask[10:30, 10:30] = mask[50:70, 50:70] = True
    strength = np.ones((100, 100))
    strength[50:, 50:] = 3.0
    assert [box[0] for box, _ in boxes_of_mask(mask, strength)] == [50, 10]
