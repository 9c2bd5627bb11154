"""Boxes about a part of the object, or about more than it."""

from pathlib import Path

import numpy as np

from re3.data.framing import Framing, frame_otherwise
from re3.data.sequence import Sequence

PART = Framing((0.25, -0.25), (0.5, 0.5))
"""The upper right quarter."""


def test_a_framing_stays_where_it_is_in_boxes_that_move_and_grow():
    boxes = np.array([[0, 0, 40, 20], [100, 50, 180, 90], [np.nan] * 4])
    expected = [[20, 0, 40, 10], [140, 50, 180, 70], [np.nan] * 4]
    np.testing.assert_allclose(PART.of(boxes), expected)


def test_sequences_framed_otherwise_keep_frames_and_lose_polygons():
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]])
    given = Sequence(
        "s", Path("v.mp4"), np.array([[0, 0, 10, 10.0]]), dataset="d", polygons=(square,)
    )
    made = frame_otherwise([given])
    assert {s.source for s in made} == {given.source}
    assert all(s.polygons is None and s.name == "s" for s in made)
    assert len({s.dataset for s in made}) == len(made) == 6
