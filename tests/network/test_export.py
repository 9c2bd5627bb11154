"""What the exporter makes of the traced graph."""

from collections import Counter

import numpy as np
import onnx
import pytest
import torch

from re3.engine import load_engine, zero_state
from re3.network.export import export_onnx
from re3.network.re3_lite import LiteConfig, Re3Lite

TINY = LiteConfig(fully_connected=16, lstm_units=8, fused=8, embedding=8, correlation=4)


@pytest.mark.parametrize(("steepest", "kept"), [(0.9, 0), (1.5, 1)])
def test_prelu_is_spelt_out_where_that_is_the_same(tmp_path, steepest, kept):
    torch.manual_seed(0)
    network = Re3Lite(TINY).eval()
    with torch.no_grad():
        for module in network.modules():
            if isinstance(module, torch.nn.PReLU):
                module.weight.uniform_(-0.5, 0.9)
        network.head.refine[1].weight[3] = steepest
    path = tmp_path / "tiny.onnx"
    export_onnx(network, path, half_weights=False)
    kinds = Counter(node.op_type for node in onnx.load(str(path)).graph.node)
    assert kinds["PRelu"] == kept
    assert kinds["Max"] == 10 - kept
    engine = load_engine(str(path), "onnx")
    crops = np.random.default_rng(0).integers(0, 256, (2, 192, 192, 3), dtype=np.uint8)
    with torch.no_grad():
        corners, score, _ = network(torch.from_numpy(crops), network.zero_state(2))
    found = engine.step(None, crops, zero_state(engine.spec, 2))
    np.testing.assert_allclose(found.corners, corners, atol=1e-4)
    np.testing.assert_allclose(found.score, score, atol=1e-4)
