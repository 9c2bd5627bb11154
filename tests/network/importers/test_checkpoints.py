"""The authors' PyTorch checkpoints: layout, arithmetic and the conventions they track by."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner
from weight_files import (
    drift,
    follow,
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
BOXES = {
    "over the top left corner": (31.3, 20.6, 80.0, 130.0),
    "larger than the frame": (150.2, 60.1, 500.5, 330.7),
}
"""xywh; the crops of both reach over the border of the frame."""

FULLY_CONNECTED, UNITS = 24, 16
RESET = 32


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
LAST = {"re3-authors": "fc_output_out.bias", "re3-authors-small": "fc_output.2.bias"}


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


@pytest.fixture(scope="module")
def frames():
    with open_source(CLIP) as source:
        return [frame.image for frame, _ in zip(source, range(66), strict=False)]


@pytest.mark.parametrize("box", BOXES.values(), ids=BOXES)
def test_the_imported_file_tracks_by_the_authors_conventions(tmp_path, case, frames, box):
    arrays, step, variant = case
    corners = geometry.convert(box, "xywh", "xyxy")
    zeros = (np.zeros((1, UNITS), np.float32),) * 4
    arrays[LAST[variant]] += drift(partial(step, arrays), zeros, frames, corners)
    boxes = follow(partial(step, arrays), zeros, frames, corners, RESET)
    save_torch(arrays, tmp_path / "checkpoint.pth")
    command = ["weights", "import", tmp_path / "checkpoint.pth", "--out", tmp_path, "--no-half"]
    result = CliRunner().invoke(app, [str(word) for word in command])
    assert result.exit_code == 0, result.output
    expected = geometry.convert(boxes, "xyxy", "xywh")
    engine = load_engine(str(tmp_path / f"{variant}.onnx"))
    assert len(expected) == 65
    np.testing.assert_allclose(track(engine, frames, box), expected, atol=0.01, rtol=0)
    assert np.ptp(expected, axis=0).min() > 0.5  # there was something to follow
    if box != BOXES["over the top left corner"]:
        return
    # Every convention shows in the boxes.
    for change in ({"look_at_reset": False}, {"whole_pixels": False}, {"fill": (127.0,) * 3}):
        other = load_engine(str(tmp_path / f"{variant}.onnx"))
        other.spec = replace(other.spec, **change)
        assert np.abs(track(other, frames, box) - expected).max() > 0.1, change


def track(engine, frames, box):
    tracker = re3.Tracker(engine=engine)
    tracker.init(frames[0], box)
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
