"""`re3`: the full model of the paper (Re3, sec. III and Fig. 1; model G of Table I)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from re3.model_spec import CropSpec, ModelSpec
from re3.network.caffenet import CROP_SIZE, EMBEDDING, CaffeNet
from re3.network.peephole_lstm import CellState, FactoredLSTM


@dataclass(frozen=True)
class Re3Config:
    """Sizes of the paper's network.

    Attributes:
        crop: of the previous and of the current frame alike.
        fully_connected: units of the layer that embeds both crops.
        lstm_units: units of each LSTM cell.
        reset_interval: steps between two resets of the recurrent state.
    """

    name: str = "re3"
    crop: CropSpec = CropSpec(context=2.0, size=CROP_SIZE)
    fully_connected: int = 2048
    lstm_units: int = 1024
    reset_interval: int = 32

    def __post_init__(self) -> None:
        if self.crop.size != CROP_SIZE:
            raise ValueError(
                f"crop size is {self.crop.size}; CaffeNet's embedding expects {CROP_SIZE}"
            )

    def spec(self) -> ModelSpec:
        return ModelSpec(
            name=self.name,
            previous=self.crop,
            current=self.crop,
            fill=(0.0, 0.0, 0.0),
            state=dict.fromkeys(FactoredLSTM.STATE_NAMES, (self.lstm_units,)),
            reset_interval=self.reset_interval,
        )


class Re3State(NamedTuple):
    """Recurrent state of N objects, each `[N, units]`; all zeros before the first forward pass."""

    lstm1_output: Tensor
    lstm1_cell: Tensor
    lstm2_output: Tensor
    lstm2_cell: Tensor


class Re3(nn.Module):
    """Convolutions, one fully connected layer, a two-layer factored LSTM, four corner values."""

    def __init__(self, config: Re3Config | None = None) -> None:
        super().__init__()
        self.config = config or Re3Config()
        self.trunk = CaffeNet()
        self.fully_connected = nn.Linear(2 * EMBEDDING, self.config.fully_connected)
        self.lstm = FactoredLSTM(self.config.fully_connected, self.config.lstm_units)
        self.corners = nn.Linear(self.config.lstm_units, 4)
        for layer in (*self.trunk.conv_skip, self.fully_connected, self.corners):
            nn.init.kaiming_normal_(layer.weight)  # MSRA for all new layers, sec. III-C
            nn.init.zeros_(layer.bias)

    def spec(self) -> ModelSpec:
        """What a tracker must know to drive this network."""
        return self.config.spec()

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> Re3State:
        """The state of so many objects before their first forward pass."""
        shapes = self.spec().state
        return Re3State(**{k: torch.zeros(objects, *s, device=device) for k, s in shapes.items()})

    def forward(
        self, previous_crops: Tensor, current_crops: Tensor, state: Re3State
    ) -> tuple[Tensor, Tensor, Re3State]:
        """One step of N objects.

        Args:
            previous_crops, current_crops: uint8 `[N, 227, 227, 3]` BGR.
            state: of the step before; `zero_state(N)` for the first.

        Returns:
            corners `[N, 4]` in the crop times `REGRESSION_SCALE`; score `[N]`, NaN throughout,
            since the paper's network has none; the new state.
        """
        both = torch.cat([self.trunk(previous_crops), self.trunk(current_crops)], dim=1)
        features = torch.relu(self.fully_connected(both))  # late fusion, sec. III-A
        recurrent, (first, second) = self.lstm(
            features,
            (
                CellState(state.lstm1_output, state.lstm1_cell),
                CellState(state.lstm2_output, state.lstm2_cell),
            ),
        )
        corners = self.corners(recurrent)
        return corners, torch.full_like(corners[:, 0], torch.nan), Re3State(*first, *second)
