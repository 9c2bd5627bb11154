"""The authors' PyTorch checkpoints: layout, arithmetic and the conventions they track by."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from typer.testing import CliRunner
from weight_files import (
    large_shapes,
    large_step,
    random_arrays,
    save_torch,
    small_shapes,
    small_step,
)

import re3
from re3 import geometry
from re3.apps.cli import app
from re3.engine import load_engine
from re3.network.authors import AuthorsConfig, AuthorsSmallConfig
from re3.network.importers import import_file
from re3.network.importers.checkpoints import LARGE, SMALL
from re3.network.variants import VARIANTS, build
from re3.network.weights import load_network
from re3.video import open_source

CLIP = Path(__file__).parents[3] / "examples" / "clips" / "person.mp4"
PICTURE = (31.3, 20.6, 80.0, 130.0)
FULLY_CONNECTED, UNITS = 24, 16
RESET = 3


@pytest.fixture
def fewer_units(monkeypatch):
    """Both networks with their convolutions, but few units behind them."""
    sizes = {"fully_connected": FULLY_CONNECTED, "lstm_units": UNITS, "reset_interval": RESET}
    monkeypatch.setitem(VARIANTS, "re3-authors", replace(AuthorsConfig(), **sizes))
    monkeypatch.setitem(VARIANTS, "re3-authors-small", replace(AuthorsSmallConfig(), **sizes))


CASES = {
    "large": (large_shapes, large_step, "re3-authors"),
    "small": (small_shapes, small_step, "re3-authors-small"),
}


@pytest.fixture(params=CASES)
def case(request, fewer_units):
    shapes, step, variant = CASES[request.param]
    return random_arrays(shapes(FULLY_CONNECTED, UNITS)), step, variant


@pytest.mark.parametrize(
    ("kind", "shapes", "values"),
    [(LARGE, large_shapes(), 190_004_324), (SMALL, small_shapes(), 116_144_132)],
    ids=["large", "small"],
)
def test_the_full_size_is_that_of_the_published_networks(kind, shapes, values):
    with torch.device("meta"):
        network = build(kind.variant)
    assert kind.shapes(network) == shapes
    assert sum(int(np.prod(shape)) for shape in shapes.values()) == values
    assert sum(p.numel() for p in network.parameters()) == values
    tensors = {name: torch.empty(shape, device="meta") for name, shape in shapes.items()}
    converted = kind.convert(tensors, network)
    own = {name: value.shape for name, value in network.state_dict().items()}
    assert {name: value.shape for name, value in converted.items()} == own


@pytest.mark.parametrize("old_form", [False, True], ids=["zip", "before torch 1.6"])
def test_a_step_is_that_of_the_files_arrays(tmp_path, case, old_form):
    arrays, step, variant = case
    save_torch(arrays, tmp_path / "checkpoint.pth", old_form=old_form)
    imported = import_file(tmp_path / "checkpoint.pth")
    network = imported.network.eval()
    assert network.config.name == variant
    assert imported.values == sum(array.size for array in arrays.values())
    rng = np.random.default_rng(1)
    state, expected = network.zero_state(2), (np.zeros((2, UNITS), np.float32),) * 4
    for _ in range(2):
        previous, current = rng.integers(0, 256, (2, 2, 227, 227, 3), dtype=np.uint8)
        with torch.no_grad():
            corners, score, state = network(
                torch.from_numpy(previous), torch.from_numpy(current), state
            )
        found, expected = step(arrays, previous, current, expected)
        np.testing.assert_allclose(corners, found, atol=3e-4)
        for name, got, wanted in zip(state._fields, state, expected, strict=True):
            np.testing.assert_allclose(got, wanted, atol=1e-4, err_msg=name)
        assert score.isnan().all()


def follow(arrays, step, frames, box_xywh):
    """The authors' conventions, step by step; boxes_xyxy of all frames after the first."""

    def region_of(box):
        return geometry.snap(geometry.search_region(box, 2.0))

    def cut(image, region):
        left, top, right, bottom = np.round(region).astype(int)
        black = np.zeros((bottom - top, right - left, 3), np.uint8)
        height, width = image.shape[:2]
        x0, y0, x1, y1 = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
        black[y0 - top : y1 - top, x0 - left : x1 - left] = image[y0:y1, x0:x1]
        return cv2.resize(black, (227, 227))[None]

    box = geometry.convert(box_xywh, "xywh", "xyxy")
    crop = cut(frames[0], region_of(box))
    _, first = step(arrays, crop, crop, (np.zeros((1, UNITS), np.float32),) * 4)
    state, boxes = first, []
    for index, (before, image) in enumerate(pairwise(frames), start=1):
        region = region_of(box)
        corners, state = step(arrays, cut(before, region), cut(image, region), state)
        low, size = region[:2], region[2:] - region[:2]
        box = np.concatenate([low, low]) + corners[0] / 10 * np.concatenate([size, size])
        boxes.append(box)
        if index % RESET == 0:
            crop = cut(image, region_of(box))
            _, state = step(arrays, crop, crop, first)
    return np.array(boxes)


def test_the_imported_file_tracks_by_the_authors_conventions(tmp_path, case):
    arrays, step, variant = case
    save_torch(arrays, tmp_path / "checkpoint.pth")
    command = ["weights", "import", tmp_path / "checkpoint.pth", "--out", tmp_path, "--no-half"]
    result = CliRunner().invoke(app, [str(word) for word in command])
    assert result.exit_code == 0, result.output
    with open_source(CLIP) as source:
        frames = [frame.image for frame, _ in zip(source, range(8), strict=False)]
    expected = geometry.convert(follow(arrays, step, frames, PICTURE), "xyxy", "xywh")
    engine = load_engine(str(tmp_path / f"{variant}.onnx"))
    np.testing.assert_allclose(track(engine, frames), expected, atol=0.02)
    assert np.ptp(expected, axis=0).min() > 0.5  # there was something to follow
    # Every convention shows in the boxes.
    for change in ({"look_at_reset": False}, {"whole_pixels": False}, {"fill": (127.0,) * 3}):
        other = load_engine(str(tmp_path / f"{variant}.onnx"))
        other.spec = replace(other.spec, **change)
        assert np.abs(track(other, frames) - expected).max() > 0.1, change


def track(engine, frames):
    tracker = re3.Tracker(engine=engine)
    tracker.init(frames[0], PICTURE)
    return np.array([tracker.update(frame).box_xywh for frame in frames[1:]])


def test_the_safetensors_file_holds_the_files_values_exactly(tmp_path, fewer_units):
    arrays = random_arrays(small_shapes(FULLY_CONNECTED, UNITS))
    save_torch(arrays, tmp_path / "checkpoint.pth")
    command = ["weights", "import", str(tmp_path / "checkpoint.pth"), "--out", str(tmp_path)]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    words = " ".join(result.output.split())
    assert "the authors' small network (PyTorch), " in words
    assert "re3-authors-small.onnx: " in words
    values = load_network(tmp_path / "re3-authors-small.safetensors").state_dict()
    np.testing.assert_array_equal(values["lstm1.input.weight"], arrays["lstm1.weight_ih"])
    np.testing.assert_array_equal(
        values["trunk.norm.3.bias"], arrays["feature_extractor.5.bn.bias"]
    )


def without(arrays, name):
    return {key: value for key, value in arrays.items() if key != name}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: without(a, "fc6.bias"), r"large network .*does not fit: missing: fc6\.bias$"),
        (lambda a: {**a, "fc7.bias": np.zeros(3)}, r"does not fit: unknown: fc7\.bias$"),
        (
            lambda a: {**a, "fc6.weight": np.zeros((24, 7), np.float32)},
            r"of another shape: fc6\.weight is \(24, 7\) and not \(24, 74208\)$",
        ),
        (
            lambda a: {**a, "fc6.bias": np.full(24, np.nan, np.float32)},
            r"fc6\.bias holds NaN or infinity",
        ),
    ],
    ids=["missing", "unknown", "shape", "not finite"],
)
def test_a_checkpoint_that_does_not_fit_is_refused(tmp_path, fewer_units, change, message):
    path = tmp_path / "checkpoint.pth"
    save_torch(change(random_arrays(large_shapes(FULLY_CONNECTED, UNITS))), path)
    with pytest.raises(ValueError, match=rf"checkpoint\.pth.*{message}"):
        import_file(path)


def test_a_whole_network_cannot_go_into_another(tmp_path, fewer_units):
    path = tmp_path / "checkpoint.pth"
    save_torch(random_arrays(small_shapes(FULLY_CONNECTED, UNITS)), path)
    with pytest.raises(ValueError, match=r"becomes 're3-authors-small'.*'re3'; leave out --into"):
        import_file(path, "re3")
