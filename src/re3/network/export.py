"""Export of the one-step graph to ONNX, with explicit state in and out."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator
from torch import Tensor, nn

from re3.model_spec import DATA_SUFFIX, SPEC_KEY
from re3.network.base import StepNetwork
from re3.network.export_integers import store_integers
from re3.network.local_response import plain_local_response
from re3.network.onnx_graph import put_nodes
from re3.network.weights import HALF_SUFFIX, SCALE_SUFFIX

OPSET = 17
OPSETS = range(13, 21)
"""Versions of ONNX's operators that a graph can be written in."""

Change = Callable[[onnx.ModelProto], onnx.ModelProto]
"""What makes a graph into another one that computes (nearly) the same."""

HALF_FROM = 256
"""Weights with fewer elements stay in single precision: they cost nothing."""


class OneStep(nn.Module):
    """The network with the state as positional tensors, as ONNX has it."""

    def __init__(self, network: StepNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        kind = type(self.network.zero_state(1))
        crops = len(inputs) - len(kind._fields)
        corners, score, new_state = self.network(*inputs[:crops], kind(*inputs[crops:]))
        return corners, score, *new_state


def export_onnx(
    network: StepNetwork,
    path: str | Path,
    *,
    half_weights: bool = True,
    opset: int = OPSET,
    change: Change | None = None,
    weights_apart: bool = False,
) -> None:
    """Write the one-step graph.

    Inputs `previous_crops` (of networks that take any) and `current_crops` are uint8
    `[N, S, S, 3]` BGR; each state comes in as `<name>` and goes out as `new_<name>`; outputs
    `corners` `[N, 4]` and `score` `[N]`.

    Args:
        network: exported in evaluation mode.
        path: of the .onnx file; written whole or not at all.
        half_weights: store weights as fp16, cast to fp32 once when the file is loaded. Arithmetic
            stays fp32.
        opset: version of the operators, one of `OPSETS`.
        change: made to the graph while its weights are fp32, such as `quantize_products`.
        weights_apart: put large weights into a file of their own, `path` with `.data` after it,
            which runtimes map into memory rather than copy. The two belong together.

    Raises:
        ValueError: another opset, or whatever `change` raises.
    """
    if opset not in OPSETS:
        raise ValueError(f"opset is {opset}; expected {OPSETS[0]} to {OPSETS[-1]}")
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.partial")
    try:
        _trace(network, partial, opset)
        model = onnx.load(str(partial))
        _pad_in_convolutions(model)
        _spell_prelu_out(model)
        store_integers(model, network)
        if change is not None:
            model = change(model)
        if half_weights:
            _halve(model)
        helper.set_model_props(model, {SPEC_KEY: network.spec().to_json()})
        onnx.checker.check_model(model)
        apart = path.with_name(path.name + DATA_SUFFIX)
        apart.unlink(missing_ok=True)  # of an earlier file of that name; it would be added to
        if weights_apart:
            onnx.save_model(
                model, partial, save_as_external_data=True, location=apart.name, size_threshold=4096
            )
            apart.chmod(partial.stat().st_mode)  # it is for its owner alone at first
        else:
            partial.write_bytes(model.SerializeToString())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def example_inputs(network: StepNetwork) -> dict[str, Tensor]:
    """Zeros for two objects by name, in the order in which `OneStep` takes them."""
    spec = network.spec()
    crops = {
        name: torch.zeros(2, crop.size, crop.size, 3, dtype=torch.uint8)
        for name, crop in (("previous_crops", spec.previous), ("current_crops", spec.current))
        if crop is not None
    }
    return {**crops, **network.zero_state(2)._asdict()}


def output_names(network: StepNetwork) -> list[str]:
    """Of what `OneStep` gives, in order."""
    return ["corners", "score", *(f"new_{name}" for name in network.spec().state)]


def _trace(network: StepNetwork, path: Path, opset: int) -> None:
    """Write the plain graph, weights under their own names."""
    inputs, outputs = example_inputs(network), output_names(network)
    training = network.training
    network.eval()
    with warnings.catch_warnings(), torch.no_grad(), plain_local_response(network):
        warnings.simplefilter("ignore")  # of the tracer, about shapes that are constant here
        torch.onnx.export(
            OneStep(network),
            tuple(inputs.values()),
            str(path),
            input_names=list(inputs),
            output_names=outputs,
            dynamic_axes={name: {0: "objects"} for name in (*inputs, *outputs)},
            # Weights keep their names, so that `load_network` finds them; the runtime folds and
            # fuses when it loads.
            do_constant_folding=False,
            training=torch.onnx.TrainingMode.PRESERVE,
            opset_version=opset,
            dynamo=False,
        )
    network.train(training)


def _pad_in_convolutions(model: onnx.ModelProto) -> None:
    """Let convolutions pad for themselves: ONNX can pad unevenly, torch's convolution cannot.

    Separate padding took 1.2 of 8.8 ms a step.
    """
    graph = model.graph
    nodes = list(graph.node)
    makers = {output: node for node in nodes for output in node.output}
    uses = Counter(name for node in graph.node for name in node.input)
    for node in nodes:
        pad = makers.get(node.input[0]) if node.op_type == "Conv" else None
        if pad is None or pad.op_type != "Pad" or uses[pad.output[0]] != 1:
            continue
        amounts = _constant(pad.input[1], nodes, makers)
        if amounts[[0, 1, 4, 5]].any():
            continue  # along batch or channels
        own = next(attribute for attribute in node.attribute if attribute.name == "pads")
        own.ints[:] = [int(a + b) for a, b in zip(own.ints, amounts[[2, 3, 6, 7]], strict=True)]
        node.input[0] = pad.input[0]
        graph.node.remove(pad)


def _spell_prelu_out(model: onnx.ModelProto) -> None:
    """Write PReLU as what ONNX Runtime computes fast; its own goes one value at a time.

    With one slope it is LeakyReLU, which is joined to the convolution before it or, in eight bits,
    looked up in a table; the node gets the weight's name, under which `load_network` finds it. With
    a slope for each channel it is the larger of x and slope times x, for slopes up to 1: a step
    took 6.4 ms before, 6.0 so.
    """
    graph = model.graph
    slopes = {weight.name: weight for weight in graph.initializer}
    for node in graph.node:
        if node.op_type == "Unsqueeze" and node.input[0] in slopes:
            slopes[node.output[0]] = slopes[node.input[0]]
    nodes = []
    for node in graph.node:
        slope = slopes.get(node.input[1]) if node.op_type == "PRelu" else None
        values = np.empty(0) if slope is None else numpy_helper.to_array(slope)
        x, output = node.input[:1], node.output
        if slope is not None and values.size == 1:
            alpha = float(values[0])
            nodes.append(helper.make_node("LeakyRelu", x, output, slope.name, alpha=alpha))
        elif slope is not None and values.max() <= 1:
            below = f"{output[0]}_below"
            nodes.append(helper.make_node("Mul", node.input, [below], f"{node.name}_below"))
            nodes.append(helper.make_node("Max", [*x, below], output, node.name))
        else:
            nodes.append(node)
    put_nodes(model, nodes)


def _constant(
    name: str, nodes: list[onnx.NodeProto], makers: dict[str, onnx.NodeProto]
) -> np.ndarray:
    """The value of a tensor that follows from constants alone; nodes are in order."""
    needed: set[str] = set()
    wanted = [name]
    while wanted:
        one = wanted.pop()
        if one and one not in needed:
            needed.add(one)
            wanted.extend(makers[one].input)
    nodes = [node for node in nodes if node.output[0] in needed]
    output = helper.make_tensor_value_info(name, TensorProto.INT64, None)
    graph = helper.make_graph(nodes, "constant", [], [output])
    opset = [helper.make_opsetid("", OPSET)]
    (value,) = ReferenceEvaluator(helper.make_model(graph, opset_imports=opset)).run(None, {})
    return np.asarray(value)


def _halve(model: onnx.ModelProto) -> None:
    """Store large fp32 weights as fp16 behind a cast, which the runtime folds when loading."""
    graph = model.graph
    casts = []
    for weight in graph.initializer:
        values = numpy_helper.to_array(weight)
        if weight.data_type != TensorProto.FLOAT or values.size < HALF_FROM:
            continue
        if weight.name.endswith(SCALE_SUFFIX):
            continue  # of integers, which would all change with it
        name = weight.name
        weight.CopyFrom(numpy_helper.from_array(values.astype(np.float16), name + HALF_SUFFIX))
        casts.append(helper.make_node("Cast", [name + HALF_SUFFIX], [name], to=TensorProto.FLOAT))
    nodes = casts + list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes)
