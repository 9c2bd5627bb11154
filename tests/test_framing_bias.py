"""What the network would change of the box given: measured at the start, taken off afterwards."""

from dataclasses import replace

import numpy as np
import pytest

import re3
from re3 import geometry
from re3.engine import StepOutput
from re3.framing_bias import MOST, NO_BIAS, SHARE, framing_bias, tried_boxes, without_bias
from re3.geometry import REGRESSION_SCALE
from re3.model_spec import CropSpec, ModelSpec

GIVEN = np.array([100.0, 50.0, 180.0, 90.0])
SPEC = ModelSpec(
    name="outlines",
    previous=None,
    current=CropSpec(context=3.0, size=480),
    fill=(0.0, 0.0, 0.0),
    state={"count": (1,)},
)


class Outlines:
    """Finds the bright rectangle in a crop, each edge half way from the box that it is shown, as a
    network that trusts the last box; its right edge too far off by a share of the width."""

    def __init__(self, too_wide, spec=SPEC):
        self.spec, self.too_wide, self.crops = spec, too_wide, 0

    def step(self, previous_crops, current_crops, state):
        self.crops += len(current_crops)
        corners = np.stack([self._found(crop) for crop in current_crops])
        score = np.full(len(corners), 0.9, np.float32)
        return StepOutput(corners.astype(np.float32), score, {"count": state["count"] + 1})

    def _found(self, crop):
        rows, columns = np.nonzero(crop[..., 0] > 127)
        sides = crop.shape[1], crop.shape[0]
        bright = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        seen = bright / np.tile(sides, 2) * REGRESSION_SCALE
        seen[2] += self.too_wide * (seen[2] - seen[0])
        return (seen + REGRESSION_SCALE * np.array([1, 1, 2, 2]) / 3) / 2


def frames(count):
    """A bright rectangle, `GIVEN`, in the dark."""
    frame = np.zeros((140, 300, 3), np.uint8)
    frame[50:90, 100:180] = 255
    return [frame] * count


def last_box(too_wide, box_xyxy=GIVEN, spec=SPEC, **options):
    tracker = re3.Tracker(engine=Outlines(too_wide, spec), **options)
    first, *others = frames(25)
    tracker.init(first, geometry.convert(box_xyxy, "xyxy", "xywh"))
    for frame in others:
        result = tracker.update(frame)
    return geometry.convert(result.box_xywh, "xywh", "xyxy")


def test_boxes_about_the_one_given_are_tried_in_balance():
    tried = tried_boxes(GIVEN)
    at = geometry.convert(tried, "xyxy", "cxcywh")
    np.testing.assert_allclose(at[:, :2].mean(axis=0), [140, 70])
    np.testing.assert_allclose(at[:, :2], [[148, 74], [132, 66], [148, 66], [132, 74]])
    np.testing.assert_allclose(np.log(at[:, 2:] / [80, 40]).mean(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("found", "bias"),
    [
        ([100, 50, 180, 90], [0, 0, 0, 0]),
        ([100, 50, 184, 90], [0, 0, 0.05, 0]),
        ([96, 52, 180, 88], [-0.05, 0.05, 0, -0.05]),
        ([60, 50, 400, 90], [-MOST, 0, MOST, 0]),  # sure of nothing
    ],
)
def test_the_bias_is_in_sides_of_the_box(found, bias):
    found = np.tile(np.array(found, np.float64), (4, 1))
    np.testing.assert_allclose(framing_bias(found, GIVEN), SHARE * np.array(bias), atol=1e-12)


def test_the_bias_is_taken_off_at_the_size_that_a_box_has():
    boxes = np.array([[0, 0, 100, 10], [0, 0, 10, 100]], np.float64)
    bias = np.array([[0.02, 0, -0.02, 0.1], NO_BIAS])
    expected = [[-2, 0, 102, 9], [0, 0, 10, 100]]
    np.testing.assert_allclose(without_bias(boxes, bias), expected)


def test_what_is_no_box_stays_none():
    assert np.isnan(without_bias(np.full((1, 4), np.nan), np.full((1, 4), 0.02))).all()


def test_a_network_that_frames_too_wide_is_held_to_the_box_given():
    free, held = (last_box(0.1, framing=framing) for framing in (False, True))
    assert free[2] - GIVEN[2] == pytest.approx(8, abs=0.7)  # a tenth of the width
    # A quarter is taken off in each step: half of the bias, which is half of what is too wide.
    assert held[2] - GIVEN[2] == pytest.approx(4, abs=0.7)
    np.testing.assert_allclose(held[[0, 1, 3]], GIVEN[[0, 1, 3]], atol=0.7)


def test_a_network_that_frames_as_the_user_is_left_alone():
    free, held = (last_box(0.0, framing=framing) for framing in (False, True))
    np.testing.assert_allclose(held, free, atol=0.3)


def test_a_box_about_a_part_is_drawn_out_less():
    part = np.array([100.0, 50.0, 172.0, 90.0])
    free, held = (last_box(0.0, part, framing=framing) for framing in (False, True))
    assert 172.5 < held[2] < free[2] - 2


def test_two_looks_are_held_only_where_asked_for():
    free, default, held = (last_box(0.1, mirror=True, framing=f) for f in (False, None, True))
    np.testing.assert_array_equal(default, free)
    assert held[2] - held[0] < free[2] - free[0] - 2


def test_a_network_that_is_shown_a_pair_of_crops_is_left_alone():
    spec = replace(SPEC, previous=CropSpec(context=2.0, size=64))
    engine = Outlines(0.1, spec)
    re3.Tracker(engine=engine).init(frames(1)[0], geometry.convert(GIVEN, "xyxy", "xywh"))
    assert engine.crops == 1
    free, held = (last_box(0.1, spec=spec, framing=framing) for framing in (False, True))
    np.testing.assert_array_equal(free, held)


def test_a_saved_state_knows_the_bias():
    first, *others = frames(8)
    tracker = re3.Tracker(engine=Outlines(0.1))
    tracker.init(first, geometry.convert(GIVEN, "xyxy", "xywh"))
    for frame in others[:3]:
        tracker.update(frame)
    other = re3.Tracker(engine=Outlines(0.1), framing=False)
    other.load_state(tracker.save_state())
    assert [other.update(f) for f in others[3:]] == [tracker.update(f) for f in others[3:]]
