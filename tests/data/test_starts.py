"""Clips from later frames, and from boxes beside the truth."""

from pathlib import Path

import numpy as np
import pytest

from re3.data.sequence import Sequence
from re3.data.starts import SAMPLED_FRAMES, sample_starts, start_later, start_shifted

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


def test_the_subset_is_some_of_the_later_and_of_the_shifted_starts():
    given = [clip(58), Sequence("t", Path("t.mp4"), clip(21).boxes_xywh, dataset="e")]
    made = sample_starts(given)
    assert {s.dataset for s in made} == {"d+e-starts"}
    ends = ("from-0", "from-8", "from-16", "from-22", "from-30", "from-38")
    shifted = tuple(f"shifted-{number}" for number in (1, 3, 6, 8, 9, 12))
    assert [s.name for s in made[:12]] == [f"d/s/{end}" for end in (*ends, *shifted)]
    # A clip of 21 frames has two frames with 20 left.
    assert [s.name for s in made[12:14]] == ["e/t/from-0", "e/t/from-1"]
    assert len(made) == 12 + 2 + 6
    every = {s.name: s for s in [*start_later(given), *start_shifted(given)]}
    for sequence in made[:12]:
        whole = every[sequence.name.removeprefix("d/")]
        np.testing.assert_array_equal(sequence.start_xywh, whole.start_xywh)
        np.testing.assert_array_equal(sequence.boxes_xywh, whole.boxes_xywh)
        assert sequence.start_frame == whole.start_frame


def test_tracks_of_the_subset_are_cut_with_all_that_belongs_to_their_frames():
    boxes = clip(400).boxes_xywh.copy()
    boxes[:5] = np.nan
    occluded = np.zeros(400, dtype=bool)
    square = np.array([[10, 20], [50, 20], [50, 40.0]])
    polygons = (None,) * 5 + (square,) * 395
    given = Sequence("s", Path("v.mp4"), boxes, occluded=occluded, polygons=polygons)
    made = {s.name.rpartition("/")[2]: s for s in sample_starts([given])}
    # Frames before the object appears are shown to the tracker, and not counted.
    assert len(made["shifted-1"]) == 5 + SAMPLED_FRAMES
    assert len(made["from-5"]) == SAMPLED_FRAMES
    last = max(s.start_frame for s in made.values())
    assert last == 380 and len(made[f"from-{last}"]) == 20
    for sequence in made.values():
        assert sequence.occluded is not None and len(sequence.occluded) == len(sequence)
        assert sequence.polygons is not None and len(sequence.polygons) == len(sequence)
