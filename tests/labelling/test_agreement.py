"""Following with two trackers, and where they agree."""

import numpy as np
import pytest
import stub_trackers as stubs

from re3.labelling.agreement import PATIENCE, Pair, follow, settled, stretches


def numbered(count):
    return [np.full((8, 8, 3), t, np.uint8) for t in range(count)]


@pytest.mark.parametrize("start", [0, 17, 39])
def test_two_that_are_right_agree_everywhere(start):
    frames = stubs.footage()
    found = follow(Pair(stubs.Bright(), stubs.Bright()), frames, start, stubs.square(start))
    np.testing.assert_allclose(found.overlaps, 1.0)
    np.testing.assert_allclose(found.boxes_xywh, [stubs.square(t) for t in range(40)])


def test_following_stops_where_they_part_in_both_directions():
    frames = stubs.footage()
    found = follow(Pair(stubs.Bright(), stubs.Stays()), frames, 20, stubs.square(20))
    # 3 px a frame: after d frames a square of 24 has an overlap of (24 - 3d) / (24 + 3d).
    expected = [max(0.0, (24 - 3 * abs(t - 20)) / (24 + 3 * abs(t - 20))) for t in range(40)]
    for t, overlap in enumerate(expected):
        np.testing.assert_allclose(found.overlaps[t], overlap if overlap >= 0.3 else 0.0)
    # Where not all three ran, there is no box.
    assert np.isnan(found.boxes_xywh[[0, 15, 25, 39]]).all()


def test_the_box_is_the_mean_of_three():
    frames = stubs.footage(30)
    found = follow(Pair(stubs.Bright(), stubs.Larger()), frames, 0, stubs.square(0))
    np.testing.assert_allclose(found.overlaps[1:], 1 / 1.25**2)
    np.testing.assert_allclose(found.boxes_xywh[5, 2:], 24 * (1 + 1 + 1.25) / 3)


def test_a_teacher_that_goes_over_to_something_else_is_found_out_on_its_way_back():
    first, other = (0, 0, 4, 4), (3, 0, 4, 4)

    def both(start, index):
        return first if index < 20 else other

    def back(start, index):
        return other if start == 39 else both(start, index)

    pair = Pair(stubs.Scripted(back), stubs.Scripted(both))
    found = follow(pair, numbered(40), 5, np.array(first, dtype=float))
    assert (found.overlaps[20:] == 1).all()
    assert (found.overlaps[:20] < 0.3).all()


def test_a_short_disagreement_does_not_stop_the_rest():
    def blinks(start, index):
        return (50, 50, 4, 4) if 10 <= index < 10 + PATIENCE - 1 else (0, 0, 4, 4)

    pair = Pair(stubs.Scripted(blinks), stubs.Scripted(lambda start, index: (0, 0, 4, 4)))
    found = follow(pair, numbered(30), 0, np.array([0.0, 0, 4, 4]))
    assert (found.overlaps[10 : 10 + PATIENCE - 1] == 0).all()
    assert (np.delete(found.overlaps, range(10, 10 + PATIENCE - 1)) == 1).all()


@pytest.mark.parametrize(
    ("teacher", "second", "region", "box"),
    [
        (stubs.Bright, stubs.Bright, (12, 28, 24, 28), (10, 30, 24, 24)),
        (stubs.Bright, stubs.Bright, (0, 0, 90, 90), None),  # far larger than what is there
        (stubs.Bright, stubs.Larger, (12, 28, 24, 28), None),  # the second sees another extent
        (lambda: stubs.Scripted(lambda s, i: (np.nan,) * 4), stubs.Bright, (12, 28, 24, 28), None),
    ],
)
def test_a_region_settles_on_what_both_see_in_it(teacher, second, region, box):
    (frame,) = stubs.footage(1)
    found = settled(Pair(teacher(), second()), frame, np.array(region, dtype=float))
    assert (None if found is None else tuple(found)) == box


@pytest.mark.parametrize(
    ("overlaps", "found"),
    [
        ("1111100000", [(0, 5)]),
        ("1110111100", [(0, 8)]),  # a gap of one
        ("1110011100", [(0, 3), (5, 8)]),  # of two
        ("1100011000", []),  # each too short
        ("0000000111", [(7, 10)]),
        ("0000000000", []),
        ("1111111111", [(0, 10)]),
    ],
)
def test_stretches(overlaps, found):
    values = np.array([0.9 if letter == "1" else 0.5 for letter in overlaps])
    assert [(s.start, s.stop) for s in stretches(values, 0.6, 3, 1)] == found


def test_the_threshold_itself_is_agreement():
    assert len(stretches(np.full(5, 0.6), 0.6, 3, 0)) == 1
