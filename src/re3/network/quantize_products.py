"""8-bit weights for the large matrix products of an exported graph.

For a network such as the paper's, whose fully connected layer alone has 152 million weights: a step
is bound by reading them. Weights get a scale for each output. Each row of the other factor is split
into two 8-bit numbers, coarse and fine, which go through one product together, so that the weights
are read once and what goes in loses nothing that counts; the scale of a row is its own, so that
a batch gives what single objects give. All of it is plain ONNX (MatMulInteger, opset 10).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from re3.network.onnx_graph import put_nodes

SMALLEST = 1 << 16
"""Products with fewer weights stay as they are: they cost nothing."""

REACH = 126
"""Weights and both parts of the input lie within this either side of zero; rounding may add 1."""

AT_A_TIME = 64

PIECE = 1 << 25
"""Larger matrices are stored in pieces of so many weights: a runtime that packs weights in an order
of its own as it loads holds a piece twice, not the whole."""

FINER = 2 * REACH
"""The fine part's unit goes so often into the coarse one's: rounding leaves half a unit a side."""

PIECE_INFIX, SCALE_SUFFIX = "_int8_", "_scale"

Int8s = NDArray[np.int8]
Floats = NDArray[np.float32]


def quantize_products(model: onnx.ModelProto) -> onnx.ModelProto:
    """Replace every product with a large constant matrix by one of 8-bit weights.

    Args:
        model: with its weights inside, fp32; changed in place.

    Returns:
        the model.

    Raises:
        ValueError: there is no such product.
    """
    graph = model.graph
    weights = {w.name: w for w in graph.initializer if w.data_type == onnx.TensorProto.FLOAT}
    opset = next(o.version for o in model.opset_import if not o.domain)
    turned = {
        node.output[0]: node
        for node in graph.node
        if node.op_type == "Transpose" and node.input[0] in weights
    }
    nodes: list[onnx.NodeProto] = []
    done: dict[str, list[str]] = {}
    for node in graph.node:
        found = _constant_matrix(node, weights, turned)
        if found is None:
            nodes.append(node)
            continue
        name, transposed = found
        if name not in done:
            constants = _constants(weights[name], transposed)
            graph.initializer.extend(constants)
            done[name] = [one.name for one in constants if one.name.startswith(name + PIECE_INFIX)]
        nodes.extend(_integer_product(node, name, done[name], opset))
    if not done:
        raise ValueError(
            f"no product with {SMALLEST} constant weights or more; this graph has nothing to gain "
            "from 8-bit weights"
        )
    graph.initializer.extend(_shared_constants())
    put_nodes(model, nodes)
    return model


def quantize(matrix: Floats) -> tuple[Int8s, Floats]:
    """8-bit weights `[inputs, outputs]` and the scale of each output: weights = int8 * scale.

    What rounding takes from one weight is given to the next, so that errors cancel where
    neighbouring inputs are alike, as those of flattened maps are, or of one sign.
    """
    scale = np.abs(matrix).max(axis=0) / REACH
    scale = np.where(scale > 0, scale, 1.0).astype(np.float32)
    values = np.empty(matrix.shape, np.int8)
    # A few outputs at a time: sums in double precision of all would take gigabytes.
    for start in range(0, matrix.shape[1], AT_A_TIME):
        few = slice(start, start + AT_A_TIME)
        sums = np.cumsum(matrix[:, few].astype(np.float64) / scale[few], axis=0)
        values[:, few] = np.diff(np.rint(sums), axis=0, prepend=0)
    return values, scale


def _constant_matrix(
    node: onnx.NodeProto, weights: dict[str, onnx.TensorProto], turned: dict[str, onnx.NodeProto]
) -> tuple[str, bool] | None:
    """Name of a product's constant factor, and whether it is stored as `[outputs, inputs]`."""
    if node.op_type not in ("Gemm", "MatMul"):
        return None
    given = {a.name: helper.get_attribute_value(a) for a in node.attribute}
    if given.get("alpha", 1.0) != 1.0 or given.get("beta", 1.0) != 1.0 or given.get("transA", 0):
        return None
    transposed, name = bool(given.get("transB", 0)), node.input[1]
    if name in turned:
        transposed, name = not transposed, turned[name].input[0]
    if name not in weights or len(weights[name].dims) != 2:
        return None
    return (name, transposed) if np.prod(weights[name].dims) >= SMALLEST else None


def _constants(weight: onnx.TensorProto, transposed: bool) -> list[onnx.TensorProto]:
    """The 8-bit matrix in pieces of some outputs each, in order, and the scales of all outputs."""
    matrix = numpy_helper.to_array(weight)
    values, scale = quantize(matrix.T if transposed else matrix)
    inputs, outputs = values.shape
    columns = max(PIECE // inputs // AT_A_TIME, 1) * AT_A_TIME
    pieces = [
        numpy_helper.from_array(
            np.ascontiguousarray(values[:, start : start + columns]),
            f"{weight.name}{PIECE_INFIX}{start}",
        )
        for start in range(0, outputs, columns)
    ]
    return [*pieces, numpy_helper.from_array(scale, weight.name + SCALE_SUFFIX)]


def _shared_constants() -> list[onnx.TensorProto]:
    values = {
        "int8_one": np.float32(1),
        "int8_middle": np.uint8(128),
        "int8_reach": np.float32(REACH),
        "int8_finer": np.float32(FINER),
        # From opset 18 on the axis is an input.
        "int8_axis": np.array([1], np.int64),
        # A row of zeros alone must not be divided by zero.
        "int8_least": np.float32(1e-30),
    }
    return [numpy_helper.from_array(np.asarray(value), name) for name, value in values.items()]


def _integer_product(
    node: onnx.NodeProto, name: str, pieces: list[str], opset: int
) -> list[onnx.NodeProto]:
    """x `[N, inputs]` times the weights: coarse and fine parts as rows of one integer product."""
    prefix, (x, *_) = f"{node.output[0]}_int8_", node.input
    nodes: list[onnx.NodeProto] = []

    def add(kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        made = prefix + output
        nodes.append(helper.make_node(kind, inputs, [made], made, **attributes))
        return made

    size = add("Abs", [x], "size")
    if opset < 18:
        largest = add("ReduceMax", [size], "largest", axes=[1], keepdims=1)
    else:
        largest = add("ReduceMax", [size, "int8_axis"], "largest", keepdims=1)
    unit = add("Div", [add("Max", [largest, "int8_least"], "some"), "int8_reach"], "unit")
    units = add("Div", [x, unit], "units")
    coarse = add("QuantizeLinear", [units, "int8_one", "int8_middle"], "coarse")
    known = add("DequantizeLinear", [coarse, "int8_one", "int8_middle"], "known")
    left = add("Mul", [add("Sub", [units, known], "difference"), "int8_finer"], "left")
    fine = add("QuantizeLinear", [left, "int8_one", "int8_middle"], "fine")
    rows = add("Concat", [coarse, fine], "rows", axis=0)
    sums = [
        add("MatMulInteger", [rows, piece, "int8_middle"], f"sums_{index}")
        for index, piece in enumerate(pieces)
    ]
    if len(sums) > 1:
        sums = [add("Concat", sums, "sums", axis=1)]
    wide = add("Cast", sums, "wide", to=onnx.TensorProto.FLOAT)
    parts = [prefix + "of_coarse", prefix + "of_fine"]
    halves: dict[str, Any] = {} if opset < 18 else {"num_outputs": 2}
    nodes.append(helper.make_node("Split", [wide], parts, prefix + "split", axis=0, **halves))
    small = add("Div", [parts[1], "int8_finer"], "small")
    whole = add("Mul", [add("Add", [parts[0], small], "both"), unit], "whole")
    # Gemm adds a bias, MatMul has none.
    bias = [name for name in node.input[2:] if name]
    product = [prefix + "product"] if bias else [node.output[0]]
    nodes.append(helper.make_node("Mul", [whole, name + SCALE_SUFFIX], product, prefix + "scaled"))
    if bias:
        add_bias = helper.make_node("Add", [*product, *bias], [node.output[0]], prefix + "biased")
        nodes.append(add_bias)
    return nodes
