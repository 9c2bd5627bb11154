"""Where an object is expected, by how it and the camera have been moving."""

import cv2
import numpy as np
import pytest

from re3.motion import LEAST_SHIFT, STILL, THUMBNAIL_SIDE, Motion, camera_motion, thumbnail

BOX = np.array([300.0, 200.0, 320.0, 240.0])  # 20 x 40 pixels


def ground(width, height, seed=0):
    """What a camera could look at: grey levels that change over some ten pixels."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 256, (height // 12, width // 12, 3), dtype=np.uint8)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (480, 854), (1920, 1080), (200, 150)])
@pytest.mark.parametrize("shift", [(0, 0), (6, -4), (-19, 11)])
def test_the_motion_of_a_camera_is_measured_in_pixels(size, shift):
    width, height = size
    world = ground(width + 80, height + 80)
    x, y = shift
    before = world[40 : 40 + height, 40 : 40 + width]
    now = world[40 - y : 40 - y + height, 40 - x : 40 - x + width]
    found = camera_motion(thumbnail(before), thumbnail(now), width, height)
    # A third of a pixel of the thumbnail.
    np.testing.assert_allclose(found, shift, atol=max(size) / THUMBNAIL_SIDE / 3 + 0.1)


def test_what_moves_in_front_is_not_the_camera():
    before, now = ground(640, 480), ground(640, 480)
    before[100:220, 100:200] = 255
    now[100:220, 130:230] = 255
    found = camera_motion(thumbnail(before), thumbnail(now), 640, 480)
    np.testing.assert_allclose(found, STILL, atol=1)


@pytest.mark.parametrize(
    ("before", "now"),
    [
        (ground(640, 480), ground(640, 480, seed=1)),
        (ground(640, 480), ground(480, 640)),
        (np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640, 3), np.uint8)),
        (np.zeros((480, 640, 3), np.uint8), ground(640, 480)),
        (np.zeros((1, 640, 3), np.uint8), np.zeros((1, 640, 3), np.uint8)),
        (np.zeros((480, 1, 3), np.uint8), np.zeros((480, 1, 3), np.uint8)),
    ],
    ids=["cut", "other size", "black", "fade in", "one row", "one column"],
)
def test_frames_without_common_motion_have_none(before, now):
    height, width = now.shape[:2]
    assert camera_motion(thumbnail(before), thumbnail(now), width, height) == STILL


@pytest.mark.parametrize("size", [(640, 480), (1919, 1081), (3840, 2160), (31, 4000), (1, 1)])
def test_a_thumbnail_is_small(size):
    width, height = size
    small = thumbnail(np.full((height, width, 3), 77, np.uint8))
    assert max(small.shape) <= THUMBNAIL_SIDE
    assert (small == 77).all()


def follow(motion, box, steps, cameras):
    """The motion and the box after an object has made some steps under a camera's."""
    for step, camera in zip(steps, cameras, strict=True):
        found = box + np.tile(step, 2)
        motion = motion.after(box, found, tuple(camera))
        box = found
    return motion, box


def shakes(count, seed=0):
    return np.random.default_rng(seed).uniform(-15, 15, (count, 2))


def test_an_object_that_goes_on_is_expected_further_on():
    steps = np.tile([9.0, -6.0], (20, 1))
    motion, box = follow(Motion(), BOX, steps, np.zeros((20, 2)))
    np.testing.assert_allclose(motion.ahead(box, STILL) - box, [9, -6, 9, -6], atol=0.3)


def test_an_object_at_rest_is_expected_where_the_camera_moves_it():
    cameras = shakes(20)
    motion, box = follow(Motion(), BOX, cameras, cameras)
    np.testing.assert_allclose(motion.ahead(box, (12.0, 5.0)) - box, [12, 5, 12, 5], atol=0.5)


def test_an_object_that_goes_on_before_a_shaking_camera_is_expected_at_the_sum():
    cameras = shakes(20)
    motion, box = follow(Motion(), BOX, np.add(cameras, [8.0, 3.0]), cameras)
    np.testing.assert_allclose(motion.ahead(box, (5.0, 5.0)) - box, [13, 8, 13, 8], atol=0.5)


def test_an_object_that_a_camera_follows_is_expected_where_it_is():
    motion, box = follow(Motion(), BOX, np.zeros((20, 2)), shakes(20))
    np.testing.assert_array_equal(motion.ahead(box, (30.0, 20.0)), box)


def test_small_steps_do_not_move_the_crop():
    width, height = BOX[2:] - BOX[:2]
    for share, moved in ((0.9, False), (1.1, True)):
        step = (share * LEAST_SHIFT * width, share * LEAST_SHIFT * height)
        motion = Motion(step=step, own_step=step)
        # With errors of none, all four guesses count alike, and two say that step.
        assert (motion.ahead(BOX, step) != BOX).any() == moved


def test_what_was_out_of_sight_has_no_step_of_its_own():
    cameras = shakes(20)
    motion, _ = follow(Motion(), BOX, np.add(cameras, [8.0, 3.0]), cameras)
    unseen = motion.unseen()
    assert unseen.step == unseen.own_step == STILL
    assert unseen.errors == motion.errors
