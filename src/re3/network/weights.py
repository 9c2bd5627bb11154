"""Weights in and out: safetensors, and the weights inside an exported ONNX file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from re3.model_spec import SPEC_KEY, ModelSpec
from re3.network.base import StepNetwork
from re3.network.mirrored import Mirrored
from re3.network.quantize import with_quantized_layers
from re3.network.re3_lite import Re3Lite
from re3.network.variants import VARIANTS, Network, build

VARIANT_KEY = "re3_variant"
HALF_SUFFIX = "_half"
"""Weights that an ONNX file stores in half precision have this after their name."""
A_SLOPE = "head.fuse.1.weight"
"""Has many values in files of `re3-lite` from before it was lean: they are of `re3-look` now."""
ONLY_LEARNT = "head.outline."
"""What is there for training alone is in no exported graph; it begins anew."""
INTEGER_SUFFIX, SCALE_SUFFIX, ZERO_SUFFIX = "_integer", "_scale", "_zero"
"""The first is after the names of those that it stores as integers, the others after those of what
one is worth and which stands for zero."""


def save_weights(network: StepNetwork, path: str | Path, *, half: bool = False) -> None:
    """Write a network's weights as safetensors, whole or not at all.

    Args:
        network: of a named variant.
        path: of the .safetensors file.
        half: store floating-point values as fp16; otherwise the file is bit-exact.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    values = {name: value.contiguous() for name, value in network.state_dict().items()}
    if half:
        values = {k: v.half() if v.is_floating_point() else v for k, v in values.items()}
    partial = path.with_suffix(f".{os.getpid()}.partial")
    save_file(values, partial, metadata={VARIANT_KEY: network.spec().name})
    partial.replace(path)


def with_only_learnt(values: Mapping[str, Tensor], network: nn.Module) -> dict[str, Tensor]:
    """Weights, and the network's own of what is there for training alone where they lack it.

    Args:
        values: by name, from an exported graph or from before there was such a thing.
        network: that they are for.
    """
    own = {name: value for name, value in network.state_dict().items() if ONLY_LEARNT in name}
    return {**own, **values}


def load_network(path: str | Path) -> Network:
    """A network with the weights of a .safetensors file or of an exported .onnx file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not such a file, an unknown variant, or weights that do not fit it.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"weights file {path} does not exist")
    if path.suffix == ".onnx":
        name, values = _read_onnx(path)
    else:
        name, values = _read_safetensors(path)
    if name == "re3-lite" and values.get(A_SLOPE, torch.empty(0)).numel() > 1:
        name = "re3-look"
    if name not in VARIANTS:
        raise ValueError(f"{path} holds weights of {name!r}; expected one of {', '.join(VARIANTS)}")
    network = build(name)
    if any(key.endswith(".input.scale") for key in values):
        if not isinstance(network, Re3Lite | Mirrored):
            raise ValueError(f"{path} has layers in eight bits, which {name!r} cannot have")
        network = with_quantized_layers(network)
    own, values = network.state_dict(), with_only_learnt(values, network)
    missing, unknown = sorted(own.keys() - values.keys()), sorted(values.keys() - own.keys())
    missing = [key for key in missing if not key.endswith("num_batches_tracked")]
    wrong = [k for k in own.keys() & values.keys() if own[k].shape != values[k].shape]
    if missing or unknown or wrong:
        raise ValueError(
            f"the weights in {path} do not fit {name!r}: missing {missing[:3]}, "
            f"unknown {unknown[:3]}, of another shape {wrong[:3]}; was it written by another "
            "version of re3?"
        )
    network.load_state_dict({**own, **{k: v.to(own[k].dtype) for k, v in values.items()}})
    return network


def _read_safetensors(path: Path) -> tuple[str, dict[str, Tensor]]:
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            return metadata.get(VARIANT_KEY, ""), {k: file.get_tensor(k) for k in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise ValueError(f"{path} cannot be read as safetensors: {error}") from error


def _read_onnx(path: Path) -> tuple[str, dict[str, Tensor]]:
    import onnx
    from google.protobuf.message import DecodeError
    from onnx import numpy_helper

    try:
        model = onnx.load(str(path))
    except DecodeError as error:
        raise ValueError(f"{path} cannot be read as an ONNX model: {error}") from error
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    if SPEC_KEY not in metadata:
        raise ValueError(
            f"{path} carries no re3 description; expected a file written by `re3 export`"
        )
    stored = {
        weight.name.removeprefix("network."): torch.from_numpy(numpy_helper.to_array(weight).copy())
        for weight in model.graph.initializer
        if weight.name.startswith("network.")
    }
    slopes = [node for node in model.graph.node if node.op_type == "LeakyRelu"]
    values = {
        node.name.removeprefix("network."): torch.tensor([node.attribute[0].f]) for node in slopes
    }
    for integers in [name for name in stored if name.endswith(INTEGER_SUFFIX)]:
        name = integers.removesuffix(INTEGER_SUFFIX)
        value, scale = stored.pop(integers), stored.pop(name + SCALE_SUFFIX)
        del stored[name + ZERO_SUFFIX]
        values[name] = value * scale.reshape(-1, *[1] * (value.dim() - 1))
        if name.endswith(".layer.weight"):
            values[name.replace(".layer.weight", ".weight_scale")] = scale
    values |= {name.removesuffix(HALF_SUFFIX): value for name, value in stored.items()}
    return ModelSpec.from_json(metadata[SPEC_KEY]).name, values
