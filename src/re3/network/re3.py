"""`re3`: the full model of the paper (Re3, sec. III and Fig. 1; model G of Table I).

By its configuration also every other model of Table I: without skip connections, with one LSTM
layer or fully connected layers alone, with other convolutions, and all of these smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from re3.geometry import REGRESSION_SCALE
from re3.model_spec import CropSpec, ModelSpec
from re3.network.base import Maps, Prediction, Seen, TrackingNetwork
from re3.network.caffenet import CROP_SIZE, SKIP_CHANNELS, CaffeNet
from re3.network.googlenet import GoogLeNet
from re3.network.lite_trunks import AlexNet, LiteTrunk
from re3.network.peephole_lstm import CellState, FactoredLSTM, NoRecurrence, OneLayerLSTM
from re3.network.skip_trunk import SkipTrunk

TRUNKS: dict[str, Callable[[tuple[int, ...]], SkipTrunk]] = {
    "caffenet": CaffeNet,
    "googlenet": GoogLeNet,
    "efficientnet-lite0": LiteTrunk,
    "alexnet": AlexNet,
}
"""Convolutions by name; each is made with the channels of its skip connections."""

SMALLEST_CROPS = {"caffenet": 67, "alexnet": 63}
"""Side in pixels below which nothing is left of the last map."""


class NoState(NamedTuple):
    """Of a network that remembers nothing."""


class OneLayerState(NamedTuple):
    """Recurrent state of N objects, each `[N, units]`; all zeros before the first forward pass."""

    lstm1_output: Tensor
    lstm1_cell: Tensor


class Re3State(NamedTuple):
    """Recurrent state of N objects, each `[N, units]`; all zeros before the first forward pass."""

    lstm1_output: Tensor
    lstm1_cell: Tensor
    lstm2_output: Tensor
    lstm2_cell: Tensor


State = NoState | OneLayerState | Re3State

_STATES: tuple[type[State], ...] = (NoState, OneLayerState, Re3State)
"""By the number of LSTM layers."""


@dataclass(frozen=True)
class Re3Config:
    """Sizes of the paper's network, and of what its ablation study leaves out or changes.

    Attributes:
        crop: of the current frame.
        previous: of the previous frame; None for one like the current.
        fill: BGR colour of what lies outside the frame.
        trunk: the convolutions, a name in `TRUNKS`.
        skips: channels of the skip connections; none without.
        fully_connected: units of the layer that embeds both crops.
        fully_connected_layers: how many of these there are, one after the other.
        lstm_layers: 2, 1, or 0 for a feed-forward network.
        lstm_units: units of each LSTM cell.
        reset_interval: steps between two resets of the recurrent state; 0 never resets.
    """

    name: str = "re3"
    crop: CropSpec = CropSpec(context=2.0, size=CROP_SIZE)
    previous: CropSpec | None = None
    fill: tuple[float, float, float] = (0.0, 0.0, 0.0)
    trunk: str = "caffenet"
    skips: tuple[int, ...] = SKIP_CHANNELS
    fully_connected: int = 2048
    fully_connected_layers: int = 1
    lstm_layers: int = 2
    lstm_units: int = 1024
    reset_interval: int = 32

    def __post_init__(self) -> None:
        if self.trunk not in TRUNKS:
            raise ValueError(f"unknown trunk {self.trunk!r}; expected one of {', '.join(TRUNKS)}")
        for crop in (self.crop, self.previous_crop):
            if self.trunk == "efficientnet-lite0" and crop.size % 16:
                raise ValueError(
                    f"crop size {crop.size} is not a multiple of the trunk's stride 16"
                )
            smallest = SMALLEST_CROPS.get(self.trunk, 0)
            if crop.size < smallest:
                raise ValueError(
                    f"crop size is {crop.size}; {self.trunk} expects {smallest} pixels or more"
                )
        if self.lstm_layers not in range(len(_STATES)) or self.fully_connected_layers < 1:
            raise ValueError(
                f"{self.lstm_layers} LSTM layers after {self.fully_connected_layers} fully "
                "connected ones; expected 0, 1 or 2 after 1 or more"
            )

    @property
    def previous_crop(self) -> CropSpec:
        """Crop of the previous frame."""
        return self.crop if self.previous is None else self.previous

    def spec(self) -> ModelSpec:
        names = _STATES[self.lstm_layers]._fields
        return ModelSpec(
            name=self.name,
            previous=self.previous_crop,
            current=self.crop,
            fill=self.fill,
            state=dict.fromkeys(names, (self.lstm_units,)),
            reset_interval=self.reset_interval,
        )


class Re3(TrackingNetwork):
    """Convolutions, one fully connected layer, a two-layer factored LSTM, four corner values."""

    trunk: SkipTrunk

    def __init__(self, config: Re3Config | None = None) -> None:
        super().__init__()
        self.config = config or Re3Config()
        config = self.config
        self.trunk = TRUNKS[config.trunk](config.skips)
        inputs = sum(self.trunk.embedding(c.size) for c in (config.previous_crop, config.crop))
        units = config.fully_connected
        self.fully_connected = nn.Linear(inputs, units)
        self.more_connected = nn.ModuleList(
            [nn.Linear(units, units) for _ in range(config.fully_connected_layers - 1)]
        )
        self.lstm: NoRecurrence | OneLayerLSTM | FactoredLSTM
        if config.lstm_layers == 2:
            self.lstm = FactoredLSTM(units, config.lstm_units)
        elif config.lstm_layers == 1:
            self.lstm = OneLayerLSTM(units, config.lstm_units)
        else:
            self.lstm = NoRecurrence()
        self.corners = nn.Linear(config.lstm_units if config.lstm_layers else units, 4)
        new = (*self.trunk.conv_skip, self.fully_connected, *self.more_connected, self.corners)
        for layer in new:
            nn.init.kaiming_normal_(layer.weight)  # MSRA for all new layers, sec. III-C
            nn.init.zeros_(layer.bias)
        with torch.no_grad():  # training sets out from the box of an object that stands still
            half = REGRESSION_SCALE / 2 / config.crop.context
            still = torch.tensor([-half, -half, half, half]) + REGRESSION_SCALE / 2
            self.corners.bias.copy_(still)

    def spec(self) -> ModelSpec:
        """What a tracker must know to drive this network."""
        return self.config.spec()

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> State:
        """The state of so many objects before their first forward pass."""
        return self._state(self._zeros(objects, device))

    def parts(self) -> dict[str, nn.Module]:
        """Everything but the pretrained convolutions, by name."""
        return {
            "skips": nn.ModuleList([*self.trunk.conv_skip, *self.trunk.prelu_skip]),
            "fully_connected": nn.ModuleList([self.fully_connected, *self.more_connected]),
            "lstm": self.lstm,
            "corners": self.corners,
        }

    def features(self, crops: Tensor) -> Maps:
        """The trunk's maps of uint8 `[N, S, S, 3]` BGR crops, previous or current."""
        return self.trunk.taps(crops)

    def look(self, previous: Maps, current: Maps) -> Tensor:
        """What both crops say, `[N, fully_connected]`: late fusion (sec. III-A)."""
        both = torch.cat([self.trunk.embed(previous), self.trunk.embed(current)], dim=1)
        features = torch.relu(self.fully_connected(both))
        for layer in self.more_connected:
            features = torch.relu(layer(features))
        return features

    def forward(
        self, previous_crops: Tensor, current_crops: Tensor, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """One step of N objects.

        Args:
            previous_crops, current_crops: uint8 `[N, S, S, 3]` BGR.
            state: of the step before; `zero_state(N)` for the first.

        Returns:
            corners `[N, 4]` in the crop times `REGRESSION_SCALE`; score `[N]`, NaN throughout,
            since the paper's network has none; the new state.
        """
        features = self.look(self.features(previous_crops), self.features(current_crops))
        recurrent, cells = self.lstm(features, _cells(state))
        corners = self.corners(recurrent)
        return corners, torch.full_like(corners[:, 0], torch.nan), self._state(_values(cells))

    def walk(self, seen: Seen, memory: State | None) -> tuple[Tensor, State]:
        """One step of N tracks; see `TrackingNetwork.walk`."""
        features = self._look(seen)
        if memory is None:
            memory = self.zero_state(len(features), features.device)
        recurrent, cells = self.lstm(features, _cells(memory))
        return self.corners(recurrent), self._state(_values(cells))

    def unroll(self, seen: Seen, steps: int) -> Prediction:
        """All steps of fresh tracks at once; only the LSTM runs step by step."""
        features = self._look(seen)
        objects = len(features) // steps
        cells = _cells(self.zero_state(objects, features.device))
        outputs = []
        for step in range(steps):
            output, cells = self.lstm(features[step * objects : (step + 1) * objects], cells)
            outputs.append(output)
        return Prediction(self.corners(torch.cat(outputs)))

    def _look(self, seen: Seen) -> Tensor:
        assert seen.previous is not None, "this network takes a crop of the previous frame"
        return self.look(seen.previous, seen.current)

    def _state(self, values: Iterable[Tensor]) -> State:
        kind: Callable[..., State] = _STATES[self.config.lstm_layers]
        return kind(*values)


def _values(cells: tuple[CellState, ...]) -> list[Tensor]:
    return [value for cell in cells for value in cell]


def _cells(state: State) -> tuple[CellState, ...]:
    values = tuple(state)
    return tuple(CellState(*values[i : i + 2]) for i in range(0, len(values), 2))
