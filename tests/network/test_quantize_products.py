"""8-bit weights: what is rounded, and what comes of it."""

from collections import Counter

import numpy as np
import onnx
import pytest
import torch

import re3
from re3.benchmark.footage import made_footage
from re3.engine import load_engine, zero_state
from re3.engine.torch_engine import TorchEngine
from re3.evaluation.still_steps import still_steps
from re3.network.export import export_onnx
from re3.network.lite_config import LiteConfig
from re3.network.quantize_products import REACH, quantize, quantize_products
from re3.network.quantize_trunk import quantize_trunk
from re3.network.re3 import Re3, Re3Config
from re3.network.re3_lite import Re3Lite
from re3.network.untrained import _calm, build_untrained

SMALL = Re3Config(fully_connected=256, lstm_units=256)


def test_weights_lie_within_a_unit_and_their_sums_within_half_a_one():
    matrix = np.random.default_rng(0).normal(0.1, 1, (500, 70)).astype(np.float32)
    values, scale = quantize(matrix)
    assert values.dtype == np.int8
    assert np.abs(values.astype(int)).max() <= REACH + 1
    errors = values * scale.astype(np.float64) - matrix
    assert (np.abs(errors) <= 1.001 * scale).all()
    # What is alike for neighbouring inputs, a sum over any first of them, keeps half a unit.
    assert (np.abs(errors.cumsum(axis=0)) <= 0.501 * scale).all()


def test_an_output_of_zeros_stays_one():
    values, scale = quantize(np.zeros((4, 2), np.float32))
    assert not values.any()
    assert np.isfinite(scale).all()


@pytest.fixture(scope="module")
def small():
    """The paper's network with fewer units, calm."""
    torch.manual_seed(0)
    network = Re3(SMALL).eval()
    _calm(network)
    return network


def exported(network, path, **options):
    export_onnx(network, path, half_weights=False, **options)
    return path


@pytest.mark.parametrize("opset", [17, 18])
def test_an_8_bit_graph_follows_the_network(small, tmp_path, opset):
    path = exported(small, tmp_path / "int8.onnx", opset=opset, change=quantize_products)
    graph = onnx.load(str(path)).graph
    # The fully connected layer and, of each cell, the input, recurrent and peephole weights.
    assert Counter(node.op_type for node in graph.node)["MatMulInteger"] == 1 + 2 * 4
    large = [w for w in graph.initializer if np.prod(w.dims) >= 1 << 16]
    wide = {w.name for w in large if w.data_type != onnx.TensorProto.INT8}
    assert all("trunk" in name for name in wide)
    engines = [TorchEngine(small), load_engine(path)]
    spec, rng = engines[0].spec, np.random.default_rng(0)
    states = [zero_state(spec, 2)] * 2
    for _ in range(5):
        crops = rng.integers(0, 256, (2, 2, 227, 227, 3), dtype=np.uint8)
        outputs = [e.step(*crops, s) for e, s in zip(engines, states, strict=True)]
        states = [output.state for output in outputs]
        # A hundredth of a unit is a thousandth of the crop's side.
        np.testing.assert_allclose(outputs[1].corners, outputs[0].corners, atol=0.02)


def test_objects_do_not_disturb_each_other(small, tmp_path):
    engine = load_engine(exported(small, tmp_path / "int8.onnx", change=quantize_products))
    rng = np.random.default_rng(0)
    crops = rng.integers(0, 256, (2, 3, 227, 227, 3), dtype=np.uint8)
    crops[:, 1] //= 8  # another range than its neighbours
    crops[:, 2] = 0
    state = zero_state(engine.spec, 3)
    together = engine.step(*crops, state)
    for index in range(3):
        one = slice(index, index + 1)
        alone = engine.step(*crops[:, one], {name: v[one] for name, v in state.items()})
        np.testing.assert_allclose(alone.corners[0], together.corners[index], atol=1e-4)


def test_a_graph_without_large_products_is_refused(tmp_path):
    tiny = LiteConfig(fully_connected=8, lstm_units=8, fused=8, embedding=8, correlation=4)
    with pytest.raises(ValueError, match="nothing to gain"):
        exported(Re3Lite(tiny), tmp_path / "int8.onnx", change=quantize_products)
    assert not list(tmp_path.iterdir())


def test_untrained_networks_are_the_same_for_the_same_seed():
    before = torch.random.get_rng_state()
    first, second, other = (build_untrained("re3-lite", seed) for seed in (0, 0, 1))
    assert torch.equal(before, torch.random.get_rng_state())
    weights = [network.head.heat.weight for network in (first, second, other)]
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


def test_the_untrained_object_stays_about_where_it_is(small, tmp_path):
    made = made_footage(6)
    tracker = re3.Tracker(str(exported(small, tmp_path / "re3.onnx")))
    tracker.init(made.frames[0], made.box_xywh)
    boxes = [tracker.update(frame).box_xywh for frame in made.frames[1:]]
    overlaps = re3.geometry.iou_xywh(boxes, made.box_xywh)
    assert overlaps[0] > 0.5


def test_a_trunk_of_8_bits_finds_nearly_the_same_corners(small, tmp_path):
    spec, made = small.spec(), made_footage(30)
    steps = still_steps(spec, made.frames, made.box_xywh)
    assert len(steps) == 29
    path = exported(
        small,
        tmp_path / "int8.onnx",
        change=lambda model: quantize_trunk(quantize_products(model), steps[::2]),
    )
    graph = onnx.load(str(path)).graph
    # Each of two passes of the trunk has four convolutions with more inputs than colours.
    rounded = {node.output[0] for node in graph.node if node.op_type == "DequantizeLinear"}
    convolutions = [node for node in graph.node if node.op_type == "Conv"]
    assert sum(node.input[1] in rounded for node in convolutions) == 2 * 4
    engines = [TorchEngine(small), load_engine(path)]
    for step in steps[1:8:2]:
        state = {name: step[name] for name in spec.state}
        crops = step["previous_crops"], step["current_crops"]
        a, b = (engine.step(*crops, state).corners for engine in engines)
        np.testing.assert_allclose(a, b, atol=0.03)
    with pytest.raises(ValueError, match="2 steps to find the ranges of maps from; expected 10"):
        quantize_trunk(onnx.load(str(path)), steps[:2])
