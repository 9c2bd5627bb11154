"""Fixtures of the engines' tests."""

import pytest


@pytest.fixture
def plain_onnx(tmp_path):
    """An ONNX file, `plain.onnx`, that is not one of re3's."""
    onnx = pytest.importorskip("onnx", reason="writes an ONNX file that is not re3's")
    path = tmp_path / "plain.onnx"
    tensor = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Relu", ["x"], ["y"])],
        "plain",
        [tensor("x", onnx.TensorProto.FLOAT, [1])],
        [tensor("y", onnx.TensorProto.FLOAT, [1])],
    )
    opset = onnx.helper.make_opsetid("", 17)
    onnx.save(onnx.helper.make_model(graph, opset_imports=[opset], ir_version=8), str(path))
    return path
