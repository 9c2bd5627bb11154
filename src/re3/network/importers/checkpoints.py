"""The PyTorch checkpoints of the paper's authors: plain state dicts of two networks.

Both feed the first LSTM cell with the fully connected layer's output, and the second with that
beside the first's output, as here; what differs is how the weights are cut up and called.
"""

from __future__ import annotations

import torch
from torch import Tensor

from re3.network.authors import AuthorsSmall
from re3.network.importers.kinds import Kind, Shape, Tensors, shapes_of
from re3.network.peephole_lstm import FactoredLSTM, PeepholeLSTMCell
from re3.network.re3 import Re3
from re3.network.variants import Network

GATES = ("block_input", "input_gate", "forget_gate", "output_gate")
"""In the order of the rows of `PeepholeLSTMCell`. Columns are x, the cell's last output and, but
for the block input, a full matrix of peepholes: on the old cell, in the output gate on the new."""

SMALL_BLOCKS = (0, 1, 3, 5, 7)
"""Places of the convolutions in the small network's `feature_extractor`."""


def _large(network: Network) -> tuple[Re3, dict[str, PeepholeLSTMCell]]:
    assert isinstance(network, Re3) and isinstance(network.lstm, FactoredLSTM)
    return network, {"lstm1": network.lstm.first, "lstm2": network.lstm.second}


def _large_shapes(network: Network) -> dict[str, Shape]:
    re3, cells = _large(network)
    shapes = shapes_of(re3.trunk.state_dict())
    layers = {"fc6": re3.fully_connected, "fc_output_out": re3.corners}
    for prefix, layer in layers.items():
        shapes[f"{prefix}.weight"] = (layer.out_features, layer.in_features)
        shapes[f"{prefix}.bias"] = (layer.out_features,)
    for prefix, cell in cells.items():
        for gate in GATES:
            states = 1 if gate == "block_input" else 2
            shapes[f"{prefix}.{gate}.weight"] = (cell.units, cell.inputs + states * cell.units)
            shapes[f"{prefix}.{gate}.bias"] = (cell.units,)
    return shapes


def _convert_large(tensors: Tensors, network: Network) -> dict[str, Tensor]:
    re3, cells = _large(network)
    values = {f"trunk.{name}": tensors[name] for name in re3.trunk.state_dict()}
    for own, prefix in (("fully_connected", "fc6"), ("corners", "fc_output_out")):
        values[f"{own}.weight"] = tensors[f"{prefix}.weight"]
        values[f"{own}.bias"] = tensors[f"{prefix}.bias"]
    for own, (prefix, cell) in zip(("first", "second"), cells.items(), strict=True):
        weights = [tensors[f"{prefix}.{gate}.weight"] for gate in GATES]
        widths = (cell.inputs, cell.units)
        of_input, of_output = (
            torch.cat(parts)
            for parts in zip(
                *(w[:, : sum(widths)].split(widths, dim=1) for w in weights), strict=True
            )
        )
        _, on_input, on_forget, on_output = (w[:, sum(widths) :] for w in weights)
        values |= {
            f"lstm.{own}.input_weight": of_input,
            f"lstm.{own}.recurrent_weight": of_output,
            f"lstm.{own}.peephole_weight": torch.cat([on_input, on_forget]),
            f"lstm.{own}.output_peephole": on_output,
            f"lstm.{own}.bias": torch.cat([tensors[f"{prefix}.{gate}.bias"] for gate in GATES]),
        }
    return values


def _small_names() -> dict[str, str]:
    """Module of ours -> module of theirs, where weights keep their names and shapes."""
    names = {"fully_connected": "fc6", "readout": "fc_output.0", "corners": "fc_output.2"}
    for index, block in enumerate(SMALL_BLOCKS):
        names[f"trunk.conv.{index}"] = f"feature_extractor.{block}.conv"
        names[f"trunk.norm.{index}"] = f"feature_extractor.{block}.bn"
    own_to_theirs = {
        f"{own}.{kind}": f"{theirs}.{kind}"
        for own, theirs in names.items()
        for kind in ("weight", "bias")
    }
    for cell in ("lstm1", "lstm2"):
        for own, theirs in (("input", "ih"), ("recurrent", "hh")):
            for kind in ("weight", "bias"):
                own_to_theirs[f"{cell}.{own}.{kind}"] = f"{cell}.{kind}_{theirs}"
    return own_to_theirs


def _small_shapes(network: Network) -> dict[str, Shape]:
    assert isinstance(network, AuthorsSmall)
    own = shapes_of(network.state_dict())
    return {theirs: own[name] for name, theirs in _small_names().items()}


def _convert_small(tensors: Tensors, _: Network) -> dict[str, Tensor]:
    return {own: tensors[theirs] for own, theirs in _small_names().items()}


LARGE = Kind(
    name="the authors' large network (PyTorch)",
    marks=("conv.0.weight", "lstm1.block_input.weight"),
    variant="re3-authors",
    whole=True,
    shapes=_large_shapes,
    convert=_convert_large,
)

SMALL = Kind(
    name="the authors' small network (PyTorch)",
    marks=("feature_extractor.0.conv.weight", "lstm1.weight_ih"),
    variant="re3-authors-small",
    whole=True,
    shapes=_small_shapes,
    convert=_convert_small,
)
