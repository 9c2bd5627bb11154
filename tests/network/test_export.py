"""What the exporter makes of the traced graph."""

from collections import Counter

import numpy as np
import onnx
import pytest
import torch

from re3.engine import load_engine, zero_state
from re3.network.export import export_onnx
from re3.network.lite_config import LiteConfig
from re3.network.local_response import PlainLocalResponse
from re3.network.re3 import Re3, Re3Config
from re3.network.re3_lite import Re3Lite
from re3.network.variants import build
from re3.network.weights import load_network

TINY = LiteConfig(fully_connected=16, lstm_units=8, fused=8, embedding=8, correlation=4)


def test_prelu_of_one_slope_becomes_leaky_relu(tmp_path):
    torch.manual_seed(0)
    network = Re3Lite(TINY).eval()
    rectifiers = [m for m in network.modules() if isinstance(m, torch.nn.PReLU)]
    assert len(rectifiers) == 16
    with torch.no_grad():
        for module in rectifiers:
            module.weight.uniform_(-0.5, 1.5)
    path = tmp_path / "tiny.onnx"
    export_onnx(network, path, half_weights=False)
    kinds = Counter(node.op_type for node in onnx.load(str(path)).graph.node)
    assert (kinds["LeakyRelu"], kinds["PRelu"]) == (16, 0)
    engine = load_engine(str(path), "onnx")
    crops = np.random.default_rng(0).integers(0, 256, (2, 192, 192, 3), dtype=np.uint8)
    with torch.no_grad():
        corners, score, _ = network(torch.from_numpy(crops), network.zero_state(2))
    found = engine.step(None, crops, zero_state(engine.spec, 2))
    np.testing.assert_allclose(found.corners, corners, atol=1e-4)
    np.testing.assert_allclose(found.score, score, atol=1e-4)


def test_slopes_are_read_back_from_an_exported_file(tmp_path):
    network = build("re3-lite")
    with torch.no_grad():
        network.head.refine[1].weight.fill_(0.375)
    export_onnx(network, tmp_path / "lite.onnx", half_weights=False)
    read = load_network(tmp_path / "lite.onnx").state_dict()
    for name, value in network.state_dict().items():
        assert name.endswith("num_batches_tracked") or torch.equal(value, read[name]), name


@pytest.mark.parametrize(("steepest", "kept"), [(0.9, 0), (1.5, 1)])
def test_prelu_of_many_slopes_is_spelt_out_where_that_is_the_same(tmp_path, steepest, kept):
    torch.manual_seed(0)
    network = Re3(Re3Config(fully_connected=8, lstm_units=8)).eval()
    skips = network.trunk.prelu_skip
    assert len(skips) == 3
    with torch.no_grad():
        for module in skips:
            module.weight.uniform_(-0.5, 0.9)
        skips[1].weight[3] = steepest
    path = tmp_path / "re3.onnx"
    export_onnx(network, path, half_weights=False)
    kinds = Counter(node.op_type for node in onnx.load(str(path)).graph.node)
    assert kinds["PRelu"] == 2 * kept  # for previous and current crops
    assert kinds["Max"] == 2 * (3 - kept)
    engine = load_engine(str(path), "onnx")
    crops = np.random.default_rng(0).integers(0, 256, (2, 2, 227, 227, 3), dtype=np.uint8)
    with torch.no_grad():
        corners, _, _ = network(*torch.from_numpy(crops), network.zero_state(2))
    found = engine.step(*crops, zero_state(engine.spec, 2))
    np.testing.assert_allclose(found.corners, corners, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [4, 5])
def test_the_plain_normalisation_is_torchs(size):
    torch.manual_seed(0)
    norm = torch.nn.LocalResponseNorm(size, alpha=0.3, beta=0.75, k=1.5)
    x = torch.randn(2, 12, 7, 7) * 4
    torch.testing.assert_close(PlainLocalResponse(norm)(x), norm(x))


def test_an_exported_normalisation_is_plain_and_the_network_stays_as_it_was(tmp_path):
    torch.manual_seed(0)
    network = Re3(Re3Config(fully_connected=8, lstm_units=8)).eval()
    path = tmp_path / "re3.onnx"
    export_onnx(network, path, half_weights=False)
    assert isinstance(network.trunk.norm, torch.nn.LocalResponseNorm)
    kinds = Counter(node.op_type for node in onnx.load(str(path)).graph.node)
    assert "Pow" not in kinds
    assert kinds["Sqrt"] == 2 * 4
    crops = np.random.default_rng(0).integers(0, 256, (2, 2, 227, 227, 3), dtype=np.uint8)
    with torch.no_grad():
        corners, _, _ = network(*torch.from_numpy(crops), network.zero_state(2))
    engine = load_engine(str(path), "onnx")
    found = engine.step(*crops, zero_state(engine.spec, 2))
    np.testing.assert_allclose(found.corners, corners, atol=1e-3)
