"""Where a lost object is looked for."""

import numpy as np
import pytest

from re3.geometry import convert
from re3.search import FRAMES_A_RING, PLACES, RINGS, SPACING, places

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
