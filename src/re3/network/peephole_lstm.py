"""The recurrent part: LSTM cells with full-matrix peepholes, two of them factored."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn


class CellState(NamedTuple):
    """State of one cell: output y and cell c, each `[N, units]`."""

    output: Tensor
    cell: Tensor


class PeepholeLSTMCell(nn.Module):
    """One step of Re3's LSTM (sec. III-B, eq. 1-6).

    The peepholes P_i, P_f and P_o are full matrices, as in the authors' PyTorch network. All
    gates' input and recurrent weights are kept in one matrix for a single product per step; rows
    are in the order block input z, input gate i, forget gate f, output gate o.

    Args:
        inputs: length of x.
        units: length of the output y and of the cell c.
    """

    def __init__(self, inputs: int, units: int) -> None:
        super().__init__()
        self.inputs = inputs
        self.units = units
        self.input_weight = nn.Parameter(torch.empty(4 * units, inputs))  # W_z, W_i, W_f, W_o
        self.recurrent_weight = nn.Parameter(torch.empty(4 * units, units))  # R_z, R_i, R_f, R_o
        self.peephole_weight = nn.Parameter(torch.empty(2 * units, units))  # P_i, P_f on c(t-1)
        self.output_peephole = nn.Parameter(torch.empty(units, units))  # P_o on c(t)
        self.bias = nn.Parameter(torch.empty(4 * units))
        self.reset_parameters()

    def reset_parameters(self) -> None:
        """MSRA initialisation over each gate's whole fan-in, biases zero (sec. III-C)."""
        # A linear (not rectified) unit keeps variance with gain 1.
        std = (self.inputs + 2 * self.units) ** -0.5
        for weight in (
            self.input_weight,
            self.recurrent_weight,
            self.peephole_weight,
            self.output_peephole,
        ):
            nn.init.normal_(weight, std=std)
        nn.init.zeros_(self.bias)

    def project(self, x: Tensor) -> Tensor:
        """W x + b of all gates, `[..., inputs]` to `[..., 4 * units]`; may run over all steps."""
        return nn.functional.linear(x, self.input_weight, self.bias)

    def recur(self, output: Tensor) -> Tensor:
        """R y of all gates, `[N, units]` to `[N, 4 * units]`."""
        return nn.functional.linear(output, self.recurrent_weight)

    def peep(self, cell: Tensor) -> Tensor:
        """P_i c and P_f c of the cell before the step, `[N, units]` to `[N, 2 * units]`."""
        return nn.functional.linear(cell, self.peephole_weight)

    def peep_after(self, cell: Tensor) -> Tensor:
        """P_o c of the cell after the step, `[N, units]`."""
        return nn.functional.linear(cell, self.output_peephole)

    def step(self, projected: Tensor, state: CellState) -> CellState:
        """The rest of the step, given `project(x)` `[N, 4 * units]`."""
        units = self.units
        gates = projected + self.recur(state.output)
        peepholes = self.peep(state.cell)
        block_input, input_and_forget, output = gates.split([units, 2 * units, units], dim=1)
        z = torch.tanh(block_input)  # eq. 1
        i, f = torch.sigmoid(input_and_forget + peepholes).split(units, dim=1)  # eq. 2, 3
        cell = i * z + f * state.cell  # eq. 4
        o = torch.sigmoid(output + self.peep_after(cell))  # eq. 5
        return CellState(output=o * torch.tanh(cell), cell=cell)  # eq. 6

    def forward(self, x: Tensor, state: CellState) -> CellState:
        """One step: x `[N, inputs]` and the state before it to the state after it."""
        return self.step(self.project(x), state)


class FactoredLSTM(nn.Module):
    """Two cells; the visual features feed both, the first's output feeds the second (sec. III-B).

    Args:
        inputs: length of the visual features.
        units: of each cell.
    """

    STATE_NAMES = ("lstm1_output", "lstm1_cell", "lstm2_output", "lstm2_cell")

    def __init__(self, inputs: int, units: int) -> None:
        super().__init__()
        self.first = PeepholeLSTMCell(inputs, units)
        self.second = PeepholeLSTMCell(inputs + units, units)

    def forward(
        self, features: Tensor, state: tuple[CellState, ...]
    ) -> tuple[Tensor, tuple[CellState, ...]]:
        """Features `[N, inputs]` to the second cell's output `[N, units]` and the new state."""
        first = self.first(features, state[0])
        second = self.second(torch.cat([features, first.output], dim=1), state[1])
        return second.output, (first, second)


class OneLayerLSTM(nn.Module):
    """A single cell (Re3, Table I, models C to F).

    Args:
        inputs: length of the visual features.
        units: of the cell.
    """

    def __init__(self, inputs: int, units: int) -> None:
        super().__init__()
        self.first = PeepholeLSTMCell(inputs, units)

    def forward(
        self, features: Tensor, state: tuple[CellState, ...]
    ) -> tuple[Tensor, tuple[CellState, ...]]:
        """Features `[N, inputs]` to the cell's output `[N, units]` and the new state."""
        first = self.first(features, state[0])
        return first.output, (first,)


class NoRecurrence(nn.Module):
    """Features as they come, without a state (Re3, Table I, models A and B)."""

    def forward(
        self, features: Tensor, state: tuple[CellState, ...]
    ) -> tuple[Tensor, tuple[CellState, ...]]:
        """Features and state, unchanged."""
        return features, state
