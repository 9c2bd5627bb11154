"""The integers of a network that computes in eight bits, in its exported graph."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import helper, numpy_helper
from torch import nn

from re3.network.quantize import Quantized
from re3.network.weights import INTEGER_SUFFIX, SCALE_SUFFIX, ZERO_SUFFIX


def store_integers(model: onnx.ModelProto, network: nn.Module) -> None:
    """Give the layers that compute in eight bits their weights and biases as integers.

    The traced graph rounds what goes in and out of them; their weights lie on their levels.
    """
    layers = {k: m for k, m in network.named_modules() if isinstance(m, Quantized)}
    if not layers:
        return
    graph = model.graph
    _narrow_zero_points(graph)
    weights = {weight.name: weight for weight in graph.initializer}
    nodes = []
    for name, layer in layers.items():
        scale = layer.weight_scale.numpy()
        stored: list[tuple[str, np.ndarray, type[np.signedinteger]]] = [("weight", scale, np.int8)]
        if layer.layer.bias is not None:
            stored.append(("bias", scale * layer.input.scale.numpy(), np.int32))
        for part, worth, kind in stored:
            weight = weights[f"network.{name}.layer.{part}"]
            output, values = weight.name, numpy_helper.to_array(weight)
            integers = np.round(values / worth.reshape(-1, *[1] * (values.ndim - 1))).astype(kind)
            names = [output + end for end in (INTEGER_SUFFIX, SCALE_SUFFIX, ZERO_SUFFIX)]
            weight.CopyFrom(numpy_helper.from_array(integers, names[0]))
            graph.initializer.append(numpy_helper.from_array(worth, names[1]))
            graph.initializer.append(numpy_helper.from_array(np.zeros(len(worth), kind), names[2]))
            nodes.append(helper.make_node("DequantizeLinear", names, [output], axis=0))
    nodes += list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes)


def _narrow_zero_points(graph: onnx.GraphProto) -> None:
    """Zero points as the 8-bit numbers that ONNX wants; torch keeps and casts them as 32-bit."""
    points = {w.name: w for w in graph.initializer if w.name.endswith(".zero_point")}
    casts = {n.output[0]: n for n in graph.node if n.op_type == "Cast" and n.input[0] in points}
    for point in points.values():
        value = numpy_helper.to_array(point).astype(np.uint8)
        point.CopyFrom(numpy_helper.from_array(value, point.name))
    for node in graph.node:
        if node.op_type in ("QuantizeLinear", "DequantizeLinear") and node.input[2] in casts:
            node.input[2] = casts[node.input[2]].input[0]
    for cast in casts.values():
        graph.node.remove(cast)
