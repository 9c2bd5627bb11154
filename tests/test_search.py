"""Where a lost object is looked for."""

import cv2
import numpy as np
import pytest

from re3.geometry import convert
from re3.search import (
    ALIKE,
    COMPARED_REACH,
    COMPARED_SIDE,
    FRAMES_A_RING,
    PLACES,
    RINGS,
    SPACING,
    alike,
    cut_patch,
    places,
)

BOX = np.array([300.0, 200.0, 320.0, 240.0])  # 20 x 40 pixels about (310, 220)
FRAME = (640, 480)


def offsets(searched_for, box=BOX, frame=FRAME):
    """Centres of the places, in steps of `SPACING` boxes from the box."""
    centre = convert(box, "xyxy", "cxcywh")
    found = convert(places(box, searched_for, *frame), "xyxy", "cxcywh")
    return np.round((found[:, :2] - centre[:2]) / centre[2:] / SPACING).astype(int).tolist()


def test_the_nearest_places_come_first():
    first = offsets(1)
    assert first[0] == [0, 0]
    assert sorted(first[1:5]) == [[-1, 0], [0, -1], [0, 1], [1, 0]]


@pytest.mark.parametrize("ring", range(1, RINGS + 1))
def test_every_place_within_reach_is_looked_at(ring):
    box = np.array([3000.0, 3000.0, 3020.0, 3040.0])
    start = (ring - 1) * FRAMES_A_RING + 1
    frames = -(-((2 * ring + 1) ** 2) // PLACES)
    if ring == RINGS:  # the search stays as wide as that
        seen = {tuple(o) for t in range(frames) for o in offsets(start + t, box, (6000, 6000))}
        assert len(seen) == (2 * ring + 1) ** 2
    reached = [o for t in range(FRAMES_A_RING) for o in offsets(start + t, box, (6000, 6000))]
    assert np.abs(reached).max() <= ring


def test_fewer_places_a_frame_reach_the_same_in_time():
    box = np.array([3000.0, 3000.0, 3020.0, 3040.0])
    few = [tuple(b) for t in range(1, 6) for b in places(box, t, 6000, 6000, count=2)]
    assert len(set(few)) == 9  # the first ring, once round
    assert {*few} == {tuple(b) for t in (1, 2) for b in places(box, t, 6000, 6000)}


def test_places_have_the_size_of_the_box():
    sizes = convert(places(BOX, 40, *FRAME), "xyxy", "cxcywh")[:, 2:]
    np.testing.assert_allclose(sizes, [[20.0, 40.0]] * PLACES)


def test_centres_stay_inside_the_frame():
    for searched_for in range(1, 60):
        found = convert(
            places(np.array([0.0, 0, 60, 60]), searched_for, 200, 100), "xyxy", "cxcywh"
        )
        assert len(found)
        assert ((found[:, :2] >= 0) & (found[:, :2] <= (200, 100))).all()


def test_a_box_off_a_tiny_frame_has_nowhere_to_look():
    assert places(np.array([-90.0, -90, -60, -60]), 1, 10, 10).shape == (0, 4)


def ground(width=640, height=480, seed=0):
    """A frame with soft spots everywhere."""
    small = np.random.default_rng(seed).integers(60, 150, (height // 8, width // 8, 3), np.uint8)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)


def put(frame, centre, size=(20, 40), gain=1.0, offset=0.0):
    """The frame with an object like no other: bright above, dark below."""
    frame, (x, y), (w, h) = frame.copy(), centre, size
    column = np.linspace(220, 20, h) * gain + offset
    frame[y - h // 2 : y + h // 2, x - w // 2 : x + w // 2] = column[:, None, None]
    return frame


PATCH = cut_patch(put(ground(), (310, 220)), BOX)


def nearest(boxes, centre):
    """How far the nearest box's centre is."""
    return np.hypot(*(convert(boxes, "xyxy", "cxcywh")[:, :2] - centre).T).min()


@pytest.mark.parametrize("centre", [(310, 220), (420, 90), (40, 400)])
def test_the_place_that_looks_most_alike_is_found_far_away(centre):
    found = alike(put(ground(seed=1), centre), [PATCH], BOX, 20)
    assert len(found) == ALIKE
    np.testing.assert_allclose(convert(found, "xyxy", "cxcywh")[:, 2:], [[20, 40]] * ALIKE)
    assert nearest(found[:1], centre) < 3  # the best is the first


def test_brightness_and_contrast_do_not_matter():
    darker = put(ground(seed=1), (420, 90), gain=0.4, offset=10)
    assert nearest(alike(darker, [PATCH], BOX, 20)[:1], (420, 90)) < 3


def test_two_places_are_two_objects():
    both = put(put(ground(seed=1), (420, 90)), (200, 300))
    found = alike(both, [PATCH], BOX, 20)
    assert nearest(found, (420, 90)) < 3
    assert nearest(found, (200, 300)) < 3


def test_each_patch_has_places_of_its_own():
    upside_down = np.ascontiguousarray(PATCH[::-1])
    assert len(alike(put(ground(seed=1), (420, 90)), [PATCH, upside_down], BOX, 20)) == 2 * ALIKE


def test_the_area_that_is_compared_grows_with_time():
    frame = put(ground(seed=1), (310, 440))
    assert nearest(alike(frame, [PATCH], BOX, 1), (310, 440)) > 60
    assert nearest(alike(frame, [PATCH], BOX, 6), (310, 440)) < 3


@pytest.mark.parametrize("size", [(8, 8), (64, 64)])
def test_the_area_has_an_end(size):
    w = size[0]
    middle = np.array([1500, 100])
    box = np.concatenate([middle - np.array(size) / 2, middle + np.array(size) / 2])
    reach = int(COMPARED_REACH / min(1, COMPARED_SIDE / w))
    frame = np.full((200, 3000, 3), 90, np.uint8)
    patch = cut_patch(put(frame, middle, size), box)
    within, beyond = middle - (reach - w, 0), middle - (reach + w, 0)
    assert nearest(alike(put(frame, within, size), [patch], box, 999), within) < w / 2
    assert not any(
        nearest([b], beyond) < w for b in alike(put(frame, beyond, size), [patch], box, 999)
    )


def test_nothing_is_compared_without_contrast_or_room():
    grey = np.full((480, 640, 3), 90, np.uint8)
    assert alike(ground(), [cut_patch(grey, BOX)], BOX, 9).shape == (0, 4)
    assert alike(grey, [PATCH], BOX, 9).shape == (0, 4)
    assert alike(ground(), [PATCH], np.array([-200.0, 0, -180, 40]), 1).shape == (0, 4)
    assert alike(ground(16, 16), [PATCH], np.array([0.0, 0, 20, 40]), 9).shape == (0, 4)


def test_a_patch_may_reach_out_of_the_frame():
    assert cut_patch(ground(), np.array([-10.0, 460, 10, 500])).shape == PATCH.shape
