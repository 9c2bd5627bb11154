"""FEAR-XS: crops, grid, choice of the box; with its files, real clips."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from re3.data.formats import read_dataset
from re3.evaluation import fear
from re3.evaluation.metrics import overlap, success_curve
from re3.evaluation.one_pass import run_one_pass
from re3.evaluation.peers import find_tracker


@pytest.mark.parametrize(
    ("context", "region"),
    [
        (fear.TEMPLATE_CONTEXT, (6, 19, 34, 33.0)),  # 1.4 times the box
        (fear.SEARCH_CONTEXT, (-30, 1, 70, 51.0)),  # five times
    ],
)
def test_crops_reach_as_far_on_each_side_as_the_box_is_wide_and_high(context, region):
    box = np.array([10.0, 21.0, 30.0, 31.0])
    np.testing.assert_allclose(fear.expanded(box, context), region)


def test_a_crop_is_stretched_rgb_and_filled_outside():
    frame = np.zeros((40, 60, 3), np.uint8)
    frame[10:20, 20:40] = (10, 20, 30)  # BGR
    crop = fear.cut(frame, np.array([20.0, 10, 40, 20]), 32, np.array([1.0, 2, 3]))
    assert crop.shape == (1, 3, 32, 32) and crop.dtype == np.float32
    np.testing.assert_array_equal(crop[0, :, 4:-4, 4:-4].min(axis=(1, 2)), (30, 20, 10))
    outside = fear.cut(frame, np.array([-100.0, -100, -50, -50]), 32, np.array([1.0, 2, 3]))
    np.testing.assert_array_equal(outside[0, :, 5, 5], (3, 2, 1))


def test_a_crop_of_its_own_size_is_the_frame():
    frame = np.random.default_rng(0).integers(0, 255, (32, 32, 3)).astype(np.uint8)
    crop = fear.cut(frame, np.array([0.0, 0, 32, 32]), 32, np.zeros(3))
    np.testing.assert_array_equal(crop[0].transpose(1, 2, 0)[..., ::-1], frame)


def test_boxes_reach_from_their_cell_as_far_as_the_distances_say():
    distances = np.zeros((4, 16, 16), dtype=np.float32)
    distances[:, 8, 8] = (1, 2, 5, 4)  # left, top, right, bottom of the point in the middle
    boxes = fear.boxes_of(distances)
    np.testing.assert_allclose(boxes[8, 8], (127, 126, 133, 132))
    np.testing.assert_allclose(boxes[0, 15], (240, 0, 240, 0))


sides = st.floats(1, 250)


@given(sides, sides)
def test_penalty_is_one_for_no_change_and_less_for_any(width, height):
    unchanged = fear.size_penalty(np.full((1, 1, 2), fear.LAST_SIDE))
    np.testing.assert_allclose(unchanged, 1.0)
    there = fear.size_penalty(np.array([[[width, height]]]))[0, 0]
    turned = fear.size_penalty(np.array([[[height, width]]]))[0, 0]
    assert 0.0 <= there <= 1.0 and there == pytest.approx(turned)


@pytest.mark.parametrize(
    ("centre", "size", "box"),
    [
        ((50, 30), (20, 10), (40, 25, 60, 35)),
        ((0, 0), (20, 10), (0, 0, 10, 5)),  # cut at the corner
        ((50, 30), (1, 1), (49.5, 29.5, 52.5, 32.5)),  # three pixels at least
        ((130, 30), (20, 10), (97, 25, 100, 35)),  # wholly outside
        ((50, 30), (500, 500), (0, 0, 100, 60)),
    ],
)
def test_boxes_stay_in_the_frame(centre, size, box):
    found = fear.inside_frame(np.array(centre, float), np.array(size, float), (60, 100, 3))
    np.testing.assert_allclose(found, box)


@pytest.fixture
def files(peers) -> list[Path]:
    found = [peers / "fear" / f"fear_xs_{part}.onnx" for part in ("template", "search")]
    for file in found:
        if not file.is_file():
            pytest.skip(f"needs the files of FEAR-XS: {file} does not exist")
    return found


def test_it_follows_what_is_easy(peers, files, moving_patch):
    images, boxes = moving_patch
    info = find_tracker("fear-xs", peers)
    assert info.factory is not None
    tracker = info.factory()
    tracker.init(images[0], boxes[0])
    for image, box in zip(images[1:], boxes[1:], strict=True):
        found, value = tracker.update(image)
        assert overlap(found, box) > 0.5 and 0.0 <= value <= 1.0


@pytest.mark.parametrize(
    "box",
    [
        (-10, -8, 40, 32),  # over the corner top left
        (140, 100, 40, 32),  # over the corner bottom right
        (80, 60, 1, 1),  # a pixel
        (0, 0, 160, 120),  # the whole frame
    ],
)
def test_boxes_stay_usable_at_the_edges(files, moving_patch, box):
    images, _ = moving_patch
    tracker = fear.FearXs(*files)
    tracker.init(images[0], box)
    for image in images[1:4]:
        found, value = tracker.update(image)
        assert np.isfinite(found).all() and (found[2:] >= fear.SMALLEST_SIDE).all()
        assert 0.0 <= value <= 1.0


def test_accuracy_is_that_of_an_independent_runner(files, shared_data):
    """.747 on SegTrack with the first frames left out, from the notes beside the files."""
    found = []
    for sequence in read_dataset(shared_data / "val" / "segtrack"):
        track = run_one_pass(partial(fear.FearXs, *files), sequence)
        followed = sequence.annotated.copy()
        followed[np.argmax(followed)] = False
        overlaps = overlap(track.boxes_xywh[followed], sequence.boxes_xywh[followed])
        found.append(success_curve(overlaps).mean())
    assert np.mean(found) == pytest.approx(0.747, abs=0.003)
