"""The integers of a network that computes in eight bits, in its exported graph."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import helper, numpy_helper
from torch import nn

from re3.network.quantize import Quantized
from re3.network.weights import INTEGER_SUFFIX, SCALE_SUFFIX, ZERO_SUFFIX

COPYING = ("Flatten", "Resize")
"""Operators that give values they are given; `Resize` does as networks here use it, to nearest."""


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
    _take_pixels_as_they_are(graph)
    _round_before_joining(graph)


def _round_before_joining(graph: onnx.GraphProto) -> None:
    """Where maps are joined and then rounded, round each of them, so that bytes are joined.

    The values are the same. Enlarged and flattened are bytes as well, and a LeakyReLU before is
    looked up in a table.
    """
    nodes = list(graph.node)
    makers = {output: node for node in nodes for output in node.output}
    for joining in [node for node in nodes if node.op_type == "Concat"]:
        users = _users(joining.output[0], nodes)
        if len(users) != 1 or users[0].op_type != "QuantizeLinear":
            continue
        levels = users[0].input[1:]
        for index, part in enumerate(joining.input):
            copying = []  # what only copies values, last first
            while _copies(makers.get(part)) and len(_users(part, nodes)) == 1:
                copying.append(makers[part])
                part = makers[part].input[0]
            name = f"{joining.name}/part{index}"
            now = f"{name}/integers"
            nodes_here = [helper.make_node("QuantizeLinear", [part, *levels], [now], now)]
            for node in reversed(copying):
                node.input[0], now = now, f"{node.output[0]}_integers"
                node.output[0] = now
                nodes.remove(node)
                nodes_here.append(node)
            joining.input[index] = f"{name}/levels"
            output = list(joining.input[index : index + 1])
            nodes_here.append(helper.make_node("DequantizeLinear", [now, *levels], output, *output))
            place = nodes.index(joining)
            nodes[place:place] = nodes_here
    del graph.node[:]
    graph.node.extend(nodes)


def _copies(node: onnx.NodeProto | None) -> bool:
    return node is not None and node.op_type in COPYING


def _users(name: str, nodes: list[onnx.NodeProto]) -> list[onnx.NodeProto]:
    return [node for node in nodes if name in node.input]


def _take_pixels_as_they_are(graph: onnx.GraphProto) -> None:
    """Pixels less a mean, rounded to steps of 1 about that mean, are the pixels: skip the way."""
    makers = {output: node for node in graph.node for output in node.output}
    values = {weight.name: weight for weight in graph.initializer}
    for rounding in [node for node in graph.node if node.op_type == "QuantizeLinear"]:
        less = makers.get(rounding.input[0])
        cast = makers.get(less.input[0]) if less is not None and less.op_type == "Sub" else None
        if less is None or cast is None or cast.op_type != "Cast":
            continue
        mean = _value(less.input[1], makers, values)
        scale, zero = (_value(name, makers, values) for name in rounding.input[1:])
        if scale == 1 and zero == mean:
            for node in graph.node:
                node.input[:] = [
                    cast.input[0] if name == rounding.output[0] else name for name in node.input
                ]
            for node in (rounding, less, cast):
                graph.node.remove(node)


def _value(
    name: str, makers: dict[str, onnx.NodeProto], values: dict[str, onnx.TensorProto]
) -> np.ndarray | None:
    """Of a weight or a constant; None for anything else."""
    if name in values:
        return np.asarray(numpy_helper.to_array(values[name]))
    node = makers.get(name)
    if node is None or node.op_type != "Constant":
        return None
    return np.asarray(numpy_helper.to_array(node.attribute[0].t))


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
