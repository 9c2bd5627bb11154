"""Eight-bit arithmetic for a trained network: static, per tensor and, for weights, per channel.

Convolutions, large fully connected layers and recurrent cells get weights of 8 bits and an input
rounded to 256 levels; in a lean network what residual blocks add up is rounded as well. The range
of these is watched while the network runs on recorded steps. In torch all values stay floats that
lie on those levels; the exported graph has the integers, and ONNX Runtime computes with them. Both
give the same values but for rounding.

Scheme: Jacob et al., "Quantization and Training of Neural Networks for Efficient
Integer-Arithmetic-Only Inference" (2018), sec. 2; after training, batch norms folded first.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from re3.network.efficientnet_lite import PIXEL_MEAN, InvertedResidual
from re3.network.lite_blocks import Adapter
from re3.network.lite_config import LiteState
from re3.network.peephole_lstm import PeepholeLSTMCell
from re3.network.re3_lite import Re3Lite

WEIGHT_LEVELS = 127
"""Weights take whole values from minus this to this, times their channel's scale."""

LARGEST_SUM = 2.0**30
"""Biases are at most so many steps of the 32-bit sums they are added to."""

LARGE = 500_000
"""Fully connected layers of so many weights are rounded: memory limits them, not arithmetic."""

FEWEST_OUTPUTS = 8
"""Convolutions to fewer maps are left as they are: the heat maps' logits, whose exact values are
the corners."""


SomeNetwork = TypeVar("SomeNetwork", bound=nn.Module)


class Levels(nn.Module):
    """Rounds to 256 evenly spaced values, zero among them; as long as it watches, it only looks."""

    scale: Tensor
    zero_point: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("scale", torch.ones(()))
        self.register_buffer("zero_point", torch.zeros((), dtype=torch.int32))
        self.seen: tuple[float, float] | None = None

    def watch(self) -> None:
        """Take note of the values' range from now on, and let them pass."""
        self.seen = (0.0, 0.0)

    def settle(self) -> None:
        """Set the levels so that they cover what was seen, and round from now on."""
        if self.seen is None:
            raise ValueError("no values were watched; call watch() and run the network first")
        low, high = self.seen
        scale = (high - low) / 255 or 1.0
        self.set(scale, round(-low / scale))

    def set(self, scale: float, zero_point: int) -> None:
        """Round from now on to whole multiples of `scale`, of which `zero_point` are below 0."""
        self.scale.fill_(scale)
        self.zero_point.fill_(zero_point)
        self.seen = None

    def forward(self, x: Tensor) -> Tensor:
        if self.seen is not None:
            self.seen = min(self.seen[0], float(x.min())), max(self.seen[1], float(x.max()))
            return x
        return torch.fake_quantize_per_tensor_affine(x, self.scale, self.zero_point, 0, 255)


class Quantized(nn.Module):
    """A layer in eight bits; `weight_scale` `[outputs]` is what one level of its weights is worth.

    Args:
        layer: convolution or fully connected.
        round_output: round what comes out, too; needless where the next layer does.
    """

    weight_scale: Tensor

    def __init__(self, layer: nn.Conv2d | nn.Linear, round_output: bool) -> None:
        super().__init__()
        self.input = Levels()
        self.layer = layer
        self.output: nn.Module = Levels() if round_output else nn.Identity()
        self.register_buffer("weight_scale", torch.ones(len(layer.weight)))

    def forward(self, x: Tensor) -> Tensor:
        return self.output(self.layer(self.input(x)))

    @torch.no_grad()
    def round_weights(self) -> None:
        """Move weights to their levels, and biases to those of the integer sums."""
        weight, bias = self.layer.weight, self.layer.bias
        scale = weight.flatten(1).abs().amax(dim=1) / WEIGHT_LEVELS
        if bias is not None:  # outputs without weights to speak of have a bias all the same
            scale = torch.maximum(scale, bias.abs() / (self.input.scale * LARGEST_SUM))
        self.weight_scale.copy_(torch.where(scale > 0, scale, torch.ones_like(scale)))
        across = self.weight_scale.reshape(-1, *[1] * (weight.dim() - 1))
        weight.copy_(torch.round(weight / across) * across)
        if bias is not None:
            step = self.weight_scale * self.input.scale
            bias.copy_(torch.round(bias / step) * step)


class QuantizedCell(PeepholeLSTMCell):
    """A recurrent cell whose products are of eight bits; what they give is not rounded.

    Args:
        cell: in full precision; its weights are copied.
    """

    def __init__(self, cell: PeepholeLSTMCell) -> None:
        nn.Module.__init__(self)
        self.inputs, self.units = cell.inputs, cell.units
        self.of_input = _product(cell.input_weight, cell.bias)
        self.of_output = _product(cell.recurrent_weight)
        self.of_cell = _product(cell.peephole_weight)
        self.of_new_cell = _product(cell.output_peephole)

    def project(self, x: Tensor) -> Tensor:
        """See `PeepholeLSTMCell.project`."""
        projected: Tensor = self.of_input(x)
        return projected

    def recur(self, output: Tensor) -> Tensor:
        """See `PeepholeLSTMCell.recur`."""
        gates: Tensor = self.of_output(output)
        return gates

    def peep(self, cell: Tensor) -> Tensor:
        """See `PeepholeLSTMCell.peep`."""
        peepholes: Tensor = self.of_cell(cell)
        return peepholes

    def peep_after(self, cell: Tensor) -> Tensor:
        """See `PeepholeLSTMCell.peep_after`."""
        peephole: Tensor = self.of_new_cell(cell)
        return peephole


def _product(weight: Tensor, bias: Tensor | None = None) -> Quantized:
    outputs, inputs = weight.shape
    # With a bias of zero, too: without one ONNX Runtime would not compute in eight bits.
    layer = nn.Linear(inputs, outputs)
    with torch.no_grad():
        layer.weight.copy_(weight)
        layer.bias.copy_(weight.new_zeros(outputs) if bias is None else bias)
    return Quantized(layer, round_output=False)


def is_quantized(network: nn.Module) -> bool:
    """Whether a network computes in eight bits."""
    return any(isinstance(module, Quantized) for module in network.modules())


def with_quantized_layers(network: SomeNetwork) -> SomeNetwork:
    """A copy of a network whose layers are made for eight bits, with levels yet to be set."""
    network = copy.deepcopy(network).eval()
    lean = all(one.config.lean for one in network.modules() if isinstance(one, Re3Lite))
    for parent in list(network.modules()):
        if lean and isinstance(parent, Adapter | InvertedResidual) and _adds(parent):
            parent.sum = Levels()
        children = list(parent.named_children())
        in_order = isinstance(parent, nn.Sequential)
        for position, (name, child) in enumerate(children):
            if isinstance(child, PeepholeLSTMCell):
                setattr(parent, name, QuantizedCell(child))
                continue
            if not isinstance(child, nn.Conv2d | nn.Linear) or not _suits(child):
                continue
            followers = [m for _, m in children[position + 1 :]] if in_order else []
            layer, norm = child, followers[0] if followers else None
            if isinstance(child, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                layer = fuse_conv_bn_eval(child, norm)
                setattr(parent, children[position + 1][0], nn.Identity())
                followers = followers[1:]
            rectified = bool(followers) and isinstance(followers[0], nn.ReLU6)
            # What a rectifier lets through is rounded at the input of the next layer.
            setattr(parent, name, Quantized(layer, round_output=not rectified))
    return network


def _adds(block: Adapter | InvertedResidual) -> bool:
    return isinstance(block, Adapter) or block.residual


def _suits(layer: nn.Conv2d | nn.Linear) -> bool:
    if isinstance(layer, nn.Conv2d):
        return layer.out_channels >= FEWEST_OUTPUTS
    return layer.weight.numel() >= LARGE


def quantize(network: Re3Lite, steps: Iterable[tuple[Tensor, LiteState]]) -> Re3Lite:
    """A network in eight bits.

    Args:
        network: trained; stays as it is.
        steps: uint8 crops `[N, S, S, 3]` and the state that each came with, from tracking
            footage of the kind that is to be tracked, first steps of a track among them.

    Returns:
        a copy that rounds; it can be exported and run, but not trained.

    Raises:
        ValueError: no steps, or the network is quantised already.
    """
    if is_quantized(network):
        raise ValueError("the network is quantised already; expected one in full precision")
    quantised = with_quantized_layers(network)
    levels = [module for module in quantised.modules() if isinstance(module, Levels)]
    for level in levels:
        level.watch()
    count = 0
    with torch.no_grad():
        for crops, state in steps:
            quantised(crops, state)
            count += 1
    if count == 0:
        raise ValueError("no recorded steps to take the ranges from; expected a hundred or more")
    for level in levels:
        level.settle()
    # Pixels have eight bits, whatever the steps showed of them.
    stem = next(m for m in quantised.trunk.modules() if isinstance(m, Quantized))
    stem.input.set(1.0, int(PIXEL_MEAN))
    for module in quantised.modules():
        if isinstance(module, Quantized):
            module.round_weights()
    return quantised
