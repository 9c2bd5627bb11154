"""Two looks at each crop: as it is, and mirrored."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import re3
from re3.engine import StepOutput, load_engine, zero_state
from re3.engine.mirrored import MirroredEngine, shares
from re3.geometry import REGRESSION_SCALE
from re3.model_spec import CropSpec, ModelSpec
from re3.models import find_eight_bits
from re3.video import open_source

CLIP = Path(__file__).parents[2] / "examples" / "clips" / "person.mp4"
PERSON = (368.0, 58.0, 158.0, 374.0)
SIDE = 32
SPEC = ModelSpec(
    "spot", CropSpec(2.0, SIDE), CropSpec(2.0, SIDE), (0.0, 0.0, 0.0), {"seen": (2, 3)}
)


class SpotEngine:
    """Finds the white spot in each crop; its state counts the brightness of the left half."""

    spec = SPEC

    def __init__(self, scores=None):
        self.scores = scores

    def step(self, previous_crops, current_crops, state):
        corners = []
        for crop in current_crops:
            rows, columns = np.nonzero(crop[:, :, 0] > 128)
            box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            corners.append(np.array(box) / SIDE * REGRESSION_SCALE)
        left = (current_crops[:, :, : SIDE // 2, 0] > 128).sum(axis=(1, 2))
        score = np.full(len(corners), 0.5) if self.scores is None else np.array(self.scores)
        return StepOutput(
            np.array(corners, np.float32),
            score.astype(np.float32),
            {"seen": (state["seen"] + left[:, None, None]).astype(np.float32)},
        )


def crop_with_spot(x, y, w, h):
    crop = np.zeros((SIDE, SIDE, 3), np.uint8)
    crop[y : y + h, x : x + w] = 255
    return crop


def test_the_mirrored_look_is_turned_back():
    crops = np.stack([crop_with_spot(3, 5, 8, 4), crop_with_spot(20, 1, 6, 9)])
    once, twice = SpotEngine(), MirroredEngine(SpotEngine())
    plain = once.step(crops, crops, zero_state(SPEC, 2))
    both = twice.step(crops, crops, zero_state(twice.spec, 2))
    np.testing.assert_allclose(both.corners, plain.corners, atol=1e-6)
    assert both.corners.dtype == np.float32
    np.testing.assert_allclose(both.score, 0.5)


def test_each_look_has_a_state_of_its_own():
    crops = np.stack([crop_with_spot(3, 5, 8, 4), crop_with_spot(20, 1, 6, 9)])
    engine = MirroredEngine(SpotEngine())
    assert engine.spec.state == {"seen": (2, 2, 3)}
    assert engine.spec.name == "spot@mirror"
    state = zero_state(engine.spec, 2)
    for _ in range(3):
        state = engine.step(crops, crops, state).state
    assert state["seen"].shape == (2, 2, 2, 3)
    np.testing.assert_array_equal(state["seen"][:, :, 0, 0], [[3 * 32, 0], [0, 3 * 54]])


def test_the_surer_look_counts_for_more():
    crop = crop_with_spot(4, 4, 8, 8)[None]
    crop[0, 20:24, 0:2] = 200  # makes the box of either look wider, on the same side

    class Unsure(SpotEngine):
        def step(self, previous_crops, current_crops, state):
            output = super().step(previous_crops, current_crops, state)
            return output._replace(corners=output.corners + np.array([[0], [1]], np.float32))

    for scores, between in (
        ([0.9, 0.1], (0, 1e-6)),
        ([0.1, 0.9], (0.999, 1)),
        ([0.5, 0.5], (0.5, 0.5)),
    ):
        plain = SpotEngine().step(None, crop, zero_state(SPEC, 1)).corners
        engine = MirroredEngine(Unsure(scores))
        found = engine.step(None, crop, zero_state(engine.spec, 1))
        moved = found.corners[0, 1] - plain[0, 1]
        assert between[0] - 1e-5 <= moved <= between[1] + 1e-5
        assert found.score[0] <= max(scores) + 1e-6


def test_two_scores_of_nothing_count_alike():
    np.testing.assert_allclose(shares(np.zeros((1, 2), np.float32)), 0.5)


@pytest.fixture(scope="module")
def frames():
    with open_source(CLIP) as source:
        return [frame.image for frame in source if frame.index < 12]


def boxes(frames, **options):
    tracker = re3.Tracker(**options)
    return [tracker.init(frames[0], PERSON).box_xywh] + [
        tracker.update(frame).box_xywh for frame in frames[1:]
    ]


def test_a_name_or_an_option_asks_for_it(frames):
    base = boxes(frames, model="re3-base")
    once = boxes(frames, model="re3-base", mirror=False)
    assert np.abs(np.subtract(base, once)).max() > 0.1
    path = str(find_eight_bits("re3-base"))  # one look
    assert base == boxes(frames, model=path, mirror=True)
    assert base == boxes(frames, engine=load_engine(path), mirror=True)
    assert once == boxes(frames, model=path)


def test_a_state_is_of_its_model(frames):
    trackers = [re3.Tracker(name) for name in ("re3-base", "re3-lite")]
    for tracker in trackers:
        tracker.init(frames[0], PERSON)
    with pytest.raises(ValueError, match="saved with model 're3-base', this tracker runs"):
        trackers[1].load_state(trackers[0].save_state())


def test_a_mirrored_picture_gives_mirrored_boxes(frames):
    """What the mean is for: neither side is preferred, which one look alone does."""
    width = frames[0].shape[1]
    x, y, w, h = PERSON

    def difference(**options):
        plain, turned = re3.Tracker("re3-base", **options), re3.Tracker("re3-base", **options)
        plain.init(frames[0], PERSON)
        turned.init(np.ascontiguousarray(frames[0][:, ::-1]), (width - x - w, y, w, h))
        apart = 0.0
        for frame in frames[1:]:
            a = plain.update(frame).box_xywh
            b = turned.update(np.ascontiguousarray(frame[:, ::-1])).box_xywh
            apart = max(apart, abs(a[0] - (width - b[0] - b[2])), abs(a[2] - b[2]))
        return apart

    assert 3 * difference() < difference(mirror=False)


def test_resets_and_crops_are_those_of_the_network():
    spec = load_engine("re3-base").spec
    once = load_engine("re3-base", mirror=False).spec
    assert once.name == "re3-look"
    assert replace(spec, name=once.name, state=once.state) == once
