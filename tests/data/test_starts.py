"""Clips from later frames, and from boxes beside the truth."""

from pathlib import Path

import numpy as np
import pytest

from re3.data.sequence import Sequence
from re3.data.starts import start_later, start_shifted

BOX = [10.0, 20.0, 40.0, 20.0]


def clip(length, **values):
    boxes = np.array([[10.0 + t, 20, 40, 20] for t in range(length)])
    return Sequence("s", Path("v.mp4"), boxes, dataset="d", **values)


def starts(sequence):
    return [made.start_frame for made in start_later([sequence])]


def test_starts_are_those_of_the_toolkit():
    # floor(1 : E / 19 : E) and E, counted from 1, of the E = 58 - 20 + 1 frames with 20 left.
    assert starts(clip(58)) == [*(39 * part // 19 for part in range(19)), 38]
    assert len(starts(clip(58))) == 20


def test_a_late_start_keeps_what_belongs_to_its_frames():
    square = np.array([[10, 20], [50, 20], [50, 40.0]])
    given = clip(30, start_frame=100, polygons=(None, square, *[None] * 27, square))
    made = {s.name: s for s in start_later([given])}
    late = made["s/from-1"]
    assert (late.start_frame, len(late), late.dataset) == (101, 29, "d-tre")
    np.testing.assert_array_equal(late.boxes_xywh, given.boxes_xywh[1:])
    assert late.polygons is not None and late.polygons[0] is not None
    assert list(made)[-1] == "s/from-10"


def test_no_start_where_the_object_is_not_or_hardly_seen():
    occluded = np.zeros(30, dtype=bool)
    occluded[3:6] = True
    boxes = clip(30).boxes_xywh.copy()
    boxes[:2] = np.nan
    given = Sequence("s", Path("v.mp4"), boxes, occluded=occluded)
    assert starts(given) == [2, 6, 7, 8, 9, 10]


@pytest.mark.parametrize("length", [1, 19, 20])
def test_a_short_clip_starts_once(length):
    assert starts(clip(length)) == [0]


def test_boxes_to_start_from_lie_beside_the_truth():
    made = start_shifted([clip(3)])
    assert {s.dataset for s in made} == {"d-sre"}
    assert len({s.name for s in made}) == 12
    for sequence in made:
        np.testing.assert_array_equal(sequence.boxes_xywh, clip(3).boxes_xywh)
    boxes = {tuple(np.round(s.start_xywh, 6)) for s in made}
    moved = {(10 + 4 * x, 20 + 2 * y, 40, 20) for x in (-1, 0, 1) for y in (-1, 0, 1)}
    scaled = {(14, 22, 32, 16), (12, 21, 36, 18), (8, 19, 44, 22), (6, 18, 48, 24)}
    assert boxes == (moved - {tuple(BOX)}) | scaled
