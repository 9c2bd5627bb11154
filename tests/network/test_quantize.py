"""Eight bits: how layers round, what the file keeps, and how far from full precision it is."""

import numpy as np
import onnx
import pytest

torch = pytest.importorskip("torch", reason="quantisation needs torch")

from re3.engine import load_engine, zero_state  # noqa: E402
from re3.network.export import export_onnx  # noqa: E402
from re3.network.lite_config import LiteConfig  # noqa: E402
from re3.network.peephole_lstm import CellState, PeepholeLSTMCell  # noqa: E402
from re3.network.quantize import (  # noqa: E402
    Levels,
    Quantized,
    QuantizedCell,
    is_quantized,
    quantize,
    with_quantized_layers,
)
from re3.network.re3_lite import Re3Lite  # noqa: E402
from re3.network.variants import build  # noqa: E402
from re3.network.weights import load_network  # noqa: E402

TINY = LiteConfig(fully_connected=16, lstm_units=8, fused=16, embedding=16, correlation=8)


def _steps(network, count=3):
    generator = torch.Generator().manual_seed(1)
    for _ in range(count):
        # A picture with shapes, which random pixels are not.
        small = torch.randint(0, 256, (2, 6, 6, 3), generator=generator, dtype=torch.uint8)
        crops = small.repeat_interleave(32, dim=1).repeat_interleave(32, dim=2)
        yield crops, network.zero_state(2)


@pytest.fixture(scope="module")
def pair():
    torch.manual_seed(0)
    network = Re3Lite(TINY).eval()
    return network, quantize(network, _steps(network))


@pytest.mark.parametrize(
    ("seen", "x", "rounded"),
    [
        ([0.0, 25.5], [0.04, 0.06, 30.0, -1.0], [0.0, 0.1, 25.5, 0.0]),  # clipped at both ends
        ([-12.7, 12.8], [0.0, -0.26, 12.79], [0.0, -0.3, 12.8]),
        ([3.0, 5.1], [0.0, 0.009, 5.1], [0.0, 0.0, 5.1]),  # zero is always one of the levels
        ([0.0, 0.0], [0.0], [0.0]),  # nothing seen
    ],
)
def test_levels_cover_what_was_seen(seen, x, rounded):
    levels = Levels()
    levels.watch()
    assert torch.equal(levels(torch.tensor(seen)), torch.tensor(seen))  # it only looks
    levels.settle()
    np.testing.assert_allclose(levels(torch.tensor(x)), rounded, atol=1e-5)


def test_levels_that_saw_nothing_say_so():
    with pytest.raises(ValueError, match=r"call watch\(\) and run the network first"):
        Levels().settle()


def test_weights_are_whole_multiples_and_nearly_the_same(pair):
    network, quantised = pair
    assert is_quantized(quantised)
    assert not is_quantized(network)
    plain = torch.nn.Conv2d(3, 8, 1)
    with torch.no_grad():
        plain.weight[5] = 0.0  # an output of a bias alone
        before = plain.weight.clone(), plain.bias.clone()
    layer = Quantized(plain, round_output=False)
    layer.input.scale.fill_(0.02)
    layer.round_weights()
    across = layer.weight_scale[:, None, None, None]
    whole = layer.layer.weight / across
    np.testing.assert_allclose(whole.detach(), whole.detach().round(), atol=1e-3)
    assert whole.abs().max() <= 127.01
    np.testing.assert_allclose(layer.layer.weight.detach(), before[0], atol=float(across.max()))
    np.testing.assert_allclose(layer.layer.bias.detach(), before[1], atol=1e-3)


def test_eight_bits_are_close_to_full_precision(pair):
    network, quantised = pair
    for crops, state in _steps(network):
        with torch.no_grad():
            exact, rounded = network(crops, state), quantised(crops, state)
        np.testing.assert_allclose(rounded[0], exact[0], atol=0.25)  # 2.5 % of a crop
        assert not torch.equal(rounded[0], exact[0])


def test_a_recurrent_cell_in_eight_bits_is_close_to_the_cell():
    torch.manual_seed(0)
    cell = PeepholeLSTMCell(12, 8)
    torch.nn.init.normal_(cell.bias, std=0.5)
    rounded = QuantizedCell(cell)
    inputs = torch.randn(20, 3, 12)
    zero = CellState(torch.zeros(3, 8), torch.zeros(3, 8))

    def walk(cell):
        state = zero
        with torch.no_grad():
            for x in inputs:
                state = cell(x, state)
        return state

    exact = walk(cell)
    products = [module for module in rounded.modules() if isinstance(module, Quantized)]
    assert len(products) == 4
    for product in products:
        product.input.watch()
    watched = walk(rounded)
    np.testing.assert_allclose(watched.cell, exact.cell, atol=1e-5)  # it only looks
    for product in products:
        product.input.settle()
        product.round_weights()
    state = walk(rounded)
    assert not torch.equal(state.output, exact.output)
    np.testing.assert_allclose(state.output, exact.output, atol=0.03)
    np.testing.assert_allclose(state.cell, exact.cell, atol=0.06)


def test_pixels_are_the_first_layer_s_levels(pair, tmp_path):
    _, quantised = pair
    stem = quantised.trunk.stem[0].input
    assert (float(stem.scale), int(stem.zero_point)) == (1.0, 127)
    path = tmp_path / "tiny.onnx"
    export_onnx(quantised, path)
    nodes = onnx.load(str(path)).graph.node
    made = {output: node for node in nodes for output in node.output}
    first = next(n for n in nodes if n.op_type == "Conv")
    levels = made[first.input[0]]
    assert levels.op_type == "DequantizeLinear"
    pixels = made[levels.input[0]]
    assert (pixels.op_type, list(pixels.input)) == ("Transpose", ["current_crops"])


def test_maps_are_joined_as_bytes(pair, tmp_path):
    _, quantised = pair
    path = tmp_path / "tiny.onnx"
    export_onnx(quantised, path)
    nodes = onnx.load(str(path)).graph.node
    made = {output: node for node in nodes for output in node.output}
    rounded = {n.input[0] for n in nodes if n.op_type == "QuantizeLinear"}
    joins = [n for n in nodes if n.op_type == "Concat" and n.output[0] in rounded]
    assert len(joins) == 3  # of the embedding, the fused map, the second cell
    for join in joins:
        levels = [made[part] for part in join.input]
        assert {node.op_type for node in levels} == {"DequantizeLinear"}
        assert len({tuple(node.input[1:]) for node in levels}) == 1
    (enlarged,) = [node for node in nodes if node.op_type == "Resize"]
    assert made[enlarged.input[0]].op_type == "QuantizeLinear"


def test_the_file_has_integers_runs_and_loads_back(pair, tmp_path):
    network, quantised = pair
    path = tmp_path / "tiny.onnx"
    export_onnx(quantised, path)
    graph = onnx.load(str(path)).graph
    kinds = {onnx.TensorProto.DataType.Name(w.data_type) for w in graph.initializer}
    assert {"INT8", "INT32", "UINT8"} <= kinds
    layers = [m for m in quantised.modules() if isinstance(m, Quantized)]
    stored = [w for w in graph.initializer if w.name.endswith("weight_integer")]
    assert len(stored) == len(layers) > 40
    engine = load_engine(str(path))
    crops, state = next(_steps(network))
    step = engine.step(None, crops.numpy(), zero_state(engine.spec, 2))
    with torch.no_grad():
        corners, _, _ = quantised(crops, state)
    # Torch and ONNX Runtime round at ties as they please; a level here and there differs.
    np.testing.assert_allclose(step.corners, corners, atol=0.1)


@pytest.mark.parametrize("model", ["re3-base", "re3-lite"])
def test_a_shipped_file_loads_into_torch_with_its_levels(model, tmp_path):
    from re3.models import find_eight_bits

    path = find_eight_bits(model)
    network = load_network(path)
    assert is_quantized(network)
    again = tmp_path / "again.onnx"
    export_onnx(network, again)
    crops, _ = next(_steps(network))
    outputs = [
        load_engine(file).step(None, crops.numpy(), zero_state(network.spec(), 2)).corners
        for file in (path, again)
    ]
    np.testing.assert_array_equal(*outputs)


@pytest.mark.parametrize(("name", "rounded"), [("re3-lite", 6 + 3), ("re3-look", 0)])
def test_what_residual_blocks_add_up_is_rounded_in_a_lean_network(name, rounded):
    quantised = with_quantized_layers(build(name))
    sums = [part for part, _ in quantised.named_modules() if part.endswith(".sum")]
    levels = [part for part in sums if isinstance(quantised.get_submodule(part), Levels)]
    assert len(levels) == rounded


def test_only_full_precision_can_be_quantised(pair):
    network, quantised = pair
    with pytest.raises(ValueError, match="quantised already"):
        quantize(quantised, _steps(network))
    with pytest.raises(ValueError, match="no recorded steps"):
        quantize(network, [])
