"""The networks of the checkpoints that the paper's authors published, with their conventions.

Their tracker differs from the paper's text in two points, in both networks: crops are cut about
whole pixels, and a reset passes the current frame through the network once more. The large network
is the paper's full model; the small one, of their later release, is defined here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from re3.model_spec import CropSpec, ModelSpec
from re3.network.base import StepNetwork
from re3.network.caffenet import CROP_SIZE
from re3.network.peephole_lstm import CellState, FactoredLSTM
from re3.network.pixels import Standardise
from re3.network.re3 import Re3Config, Re3State

NORM_GROUPS = 32
FIRST_POOLED = 2
"""The small network halves its maps before this block and before every later one."""


@dataclass(frozen=True)
class AuthorsConfig(Re3Config):
    """The paper's network, driven as the authors' released tracker drives it."""

    name: str = "re3-authors"

    def spec(self) -> ModelSpec:
        return replace(super().spec(), look_at_reset=True, whole_pixels=True)


@dataclass(frozen=True)
class AuthorsSmallConfig:
    """Sizes of the authors' small network.

    Attributes:
        crop: of the previous and of the current frame alike.
        channels: of the five convolutions.
        fully_connected: units of the layer that embeds both crops.
        lstm_units: units of each LSTM cell, and of the layer between them and the corners.
        reset_interval: steps between two resets of the recurrent state.
    """

    name: str = "re3-authors-small"
    crop: CropSpec = CropSpec(context=2.0, size=CROP_SIZE)
    channels: tuple[int, int, int, int, int] = (32, 64, 128, 256, 512)
    fully_connected: int = 2048
    lstm_units: int = 512
    reset_interval: int = 32

    def __post_init__(self) -> None:
        if any(channels % NORM_GROUPS for channels in self.channels):
            raise ValueError(
                f"channels are {self.channels}; expected multiples of {NORM_GROUPS}, the groups "
                "of the normalisation"
            )

    @property
    def embedding(self) -> int:
        """Values per crop."""
        side = (self.crop.size - 1) // 4 + 1  # of a convolution of stride 4 with same padding
        return (side // 2 ** (len(self.channels) - FIRST_POOLED)) ** 2 * self.channels[-1]

    def spec(self) -> ModelSpec:
        return ModelSpec(
            name=self.name,
            previous=self.crop,
            current=self.crop,
            fill=(0.0, 0.0, 0.0),
            state=dict.fromkeys(FactoredLSTM.STATE_NAMES, (self.lstm_units,)),
            reset_interval=self.reset_interval,
            look_at_reset=True,
            whole_pixels=True,
        )


class LSTMCell(nn.Module):
    """An LSTM cell without peepholes; rows of its weights in the order i, f, g, o.

    Args:
        inputs: length of x.
        units: length of the output and of the cell.
    """

    def __init__(self, inputs: int, units: int) -> None:
        super().__init__()
        self.input = nn.Linear(inputs, 4 * units)
        self.recurrent = nn.Linear(units, 4 * units)

    def forward(self, x: Tensor, state: CellState) -> CellState:
        """One step: x `[N, inputs]` and the state before it to the state after it."""
        gates = self.input(x) + self.recurrent(state.output)
        i, f, g, o = gates.chunk(4, dim=1)
        cell = torch.sigmoid(f) * state.cell + torch.sigmoid(i) * torch.tanh(g)
        return CellState(output=torch.sigmoid(o) * torch.tanh(cell), cell=cell)


class SmallTrunk(nn.Module):
    """Convolutions with group normalisation and ELU; no skips.

    Args:
        channels: of each convolution.
    """

    def __init__(self, channels: Sequence[int]) -> None:
        super().__init__()
        widths = (3, *channels)
        self.conv = nn.ModuleList(
            [
                nn.Conv2d(inputs, outputs, 3, padding=1)
                if index
                else nn.Conv2d(inputs, outputs, 7, stride=4, padding=3)
                for index, (inputs, outputs) in enumerate(zip(widths, channels, strict=False))
            ]
        )
        self.norm = nn.ModuleList([nn.GroupNorm(NORM_GROUPS, width) for width in channels])
        self.standardise = Standardise()

    def forward(self, crops: Tensor) -> Tensor:
        """uint8 `[N, S, S, 3]` BGR to the last map, flattened, `[N, E]`."""
        x = self.standardise(crops)
        for index, (conv, norm) in enumerate(zip(self.conv, self.norm, strict=True)):
            if index >= FIRST_POOLED:
                x = F.max_pool2d(x, 2)
            x = F.elu(norm(conv(x)))
        return x.flatten(1)


class AuthorsSmall(StepNetwork):
    """Five convolutions, one fully connected layer, two plain LSTM cells, two layers to corners."""

    def __init__(self, config: AuthorsSmallConfig | None = None) -> None:
        super().__init__()
        self.config = config or AuthorsSmallConfig()
        units = self.config.lstm_units
        self.trunk = SmallTrunk(self.config.channels)
        self.fully_connected = nn.Linear(2 * self.config.embedding, self.config.fully_connected)
        self.lstm1 = LSTMCell(self.config.fully_connected, units)
        self.lstm2 = LSTMCell(self.config.fully_connected + units, units)
        self.readout = nn.Linear(units, units)
        self.corners = nn.Linear(units, 4)

    def spec(self) -> ModelSpec:
        """What a tracker must know to drive this network."""
        return self.config.spec()

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> Re3State:
        """The state of so many objects before their first forward pass."""
        return Re3State(*self._zeros(objects, device))

    def forward(
        self, previous_crops: Tensor, current_crops: Tensor, state: Re3State
    ) -> tuple[Tensor, Tensor, Re3State]:
        """One step of N objects; see `re3.network.re3.Re3.forward`."""
        both = torch.cat([self.trunk(previous_crops), self.trunk(current_crops)], dim=1)
        features = F.elu(self.fully_connected(both))
        first = self.lstm1(features, CellState(state.lstm1_output, state.lstm1_cell))
        second = self.lstm2(
            torch.cat([features, first.output], dim=1),
            CellState(state.lstm2_output, state.lstm2_cell),
        )
        corners = self.corners(F.elu(self.readout(second.output)))
        return corners, torch.full_like(corners[:, 0], torch.nan), Re3State(*first, *second)
