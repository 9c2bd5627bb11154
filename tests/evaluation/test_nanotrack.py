from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from re3.evaluation import nanotrack, opencv_trackers
from re3.evaluation.metrics import overlap


@pytest.mark.parametrize(
    ("background", "object_", "probability"),
    [
        (0.0, 0.0, 0.5),  # undecided
        (0.0, np.log(3.0), 0.75),  # odds of three to one
        (np.log(3.0), 0.0, 0.25),
        (-1000.0, 1000.0, 1.0),  # does not overflow
        (1000.0, -1000.0, 0.0),
    ],
)
def test_foreground_is_the_softmax_of_the_second_class(background, object_, probability):
    logits = np.array([[[background]], [[object_]]], dtype=np.float32)
    assert nanotrack.foreground(logits)[0, 0] == pytest.approx(probability, abs=1e-6)


def test_boxes_reach_from_the_cell_as_far_as_told():
    distances = np.zeros((4, 3, 3), dtype=np.float32)
    distances[:, 0, 2] = (1, 2, 5, 4)  # left, top, right, bottom of the cell top right
    boxes = nanotrack.boxes_of(distances, np.array([-16.0, 0.0, 16.0]))
    # From 15, -18 to 21, -12.
    np.testing.assert_allclose(boxes[0, 2], (18, -15, 6, 6))
    np.testing.assert_allclose(boxes[2, 1], (0, 16, 0, 0))


def test_crop_side_of_a_square_is_twice_its_side():
    assert nanotrack.crop_side(np.array([30.0, 30.0])) == pytest.approx(60.0)


sides = st.floats(1, 500)


@given(sides, sides, sides, sides, st.floats(0.01, 1))
def test_penalty_is_for_change_in_either_direction(w, h, other_w, other_h, strength):
    one, other = np.array([w, h]), np.array([other_w, other_h])
    there = nanotrack.size_penalty(other[None, None], one, strength)
    back = nanotrack.size_penalty(one[None, None], other, strength)
    np.testing.assert_allclose(there, back)
    assert 0.0 <= there[0, 0] <= 1.0
    same = nanotrack.size_penalty(one[None, None], one, strength)
    np.testing.assert_allclose(same, 1.0)


def files(peers: Path, version: str) -> list[Path]:
    folder = peers / "nanotrack" / version
    return [folder / f"nanotrack_{part}_sim.onnx" for part in ("backbone", "head")]


@pytest.mark.parametrize(("version", "settings"), [("v1", nanotrack.V1), ("v2", nanotrack.V2)])
def test_ours_agrees_with_opencv_on_versions_both_run(peers, moving_patch, version, settings):
    images, boxes = moving_patch
    ours = nanotrack.NanoTrack(*files(peers, version), settings)
    theirs = opencv_trackers.nanotrack(*files(peers, version))
    ours.init(images[0], boxes[0])
    theirs.init(images[0], boxes[0])
    for image in images[1:]:
        (box, _), (other, _) = ours.update(image), theirs.update(image)
        # OpenCV rounds boxes to pixels and has settings of its own.
        assert overlap(box, other) > 0.7


@pytest.mark.parametrize(
    "box",
    [
        (-10, -8, 40, 32),  # over the corner top left
        (140, 100, 40, 32),  # over the corner bottom right
        (80, 60, 1, 1),  # a pixel
        (0, 0, 160, 120),  # the whole frame
    ],
)
def test_boxes_stay_usable_at_the_edges(peers, moving_patch, box):
    images, _ = moving_patch
    tracker = nanotrack.NanoTrack(*files(peers, "v3"))
    tracker.init(images[0], box)
    for image in images[1:4]:
        found, score = tracker.update(image)
        assert np.isfinite(found).all() and (found[2:] >= nanotrack.SMALLEST_SIDE).all()
        assert 0.0 <= score <= 1.0
