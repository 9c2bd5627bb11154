"""`re3-lite`: Re3's recurrent regression sized for a CPU, its regression made spatial.

Kept from the paper: a pair of crops centred on the previous box, shared convolutions with skip
connections through 1x1 convolutions and PReLU, one fully connected layer, a two-layer factored
peephole LSTM whose state is the model of the object, corners in crop coordinates under an L1 loss.

Changed: the object part of the previous crop, and of the very first one, is correlated with the
current crop; the fused map is read out as two heat maps (top-left and bottom-right corner), whose
channels the LSTM's output scales and shifts; the current crop reaches further than the previous
one, for fast motion. A head predicts the overlap of the box with the object.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from re3.geometry import REGRESSION_SCALE
from re3.model_spec import CropSpec, ModelSpec
from re3.network.efficientnet_lite import (
    OUT_CHANNELS,
    PIXEL_MEAN,
    EfficientNetLite0,
)
from re3.network.peephole_lstm import CellState, FactoredLSTM

STRIDE = 8
"""Stride of the embedding's grid."""

Features = tuple[Tensor, Tensor, Tensor]
"""Trunk maps of one crop at strides 4, 8 and 16."""


@dataclass(frozen=True)
class LiteConfig:
    """Sizes of a `re3-lite` variant; channels unless said otherwise.

    Attributes:
        previous: crop of the previous frame. Its middle, the object, is the template.
        current: crop of the current frame, at the same pixels per object as the previous one.
        skips: outputs of the skip connections from strides 4, 8 and 16 (sec. III-A).
        embedding: of a crop's embedding.
        correlation: kept of each correlation.
        fused: of the fused map.
        fully_connected: units of the fully connected layer.
        lstm_units: units of each LSTM cell.
        reset_interval: steps between two resets of the recurrent state.
    """

    name: str = "re3-lite"
    previous: CropSpec = CropSpec(context=2.0, size=128)
    current: CropSpec = CropSpec(context=3.0, size=192)
    skips: tuple[int, int, int] = (16, 32, 64)
    embedding: int = 64
    correlation: int = 48
    fused: int = 64
    fully_connected: int = 384
    lstm_units: int = 256
    reset_interval: int = 32

    def __post_init__(self) -> None:
        for crop in (self.previous, self.current):
            if crop.size % 16:
                raise ValueError(
                    f"crop size {crop.size} is not a multiple of the trunk's stride 16"
                )
        if (
            abs(
                self.previous.size / self.previous.context
                - self.current.size / self.current.context
            )
            > 1
        ):
            raise ValueError(
                f"the object would have {self.previous.size / self.previous.context:.0f} pixels in "
                f"the previous crop and {self.current.size / self.current.context:.0f} in the "
                "current one; expected the same, since one is correlated with the other"
            )

    @property
    def template_cells(self) -> int:
        """Side of the template on the embedding's grid: the object's part of the previous crop."""
        return round(self.previous.size / self.previous.context / STRIDE)

    def spec(self) -> ModelSpec:
        units = self.lstm_units
        return ModelSpec(
            name=self.name,
            previous=self.previous,
            current=self.current,
            fill=(PIXEL_MEAN, PIXEL_MEAN, PIXEL_MEAN),
            state={
                **dict.fromkeys(FactoredLSTM.STATE_NAMES, (units,)),
                "template": (self.embedding, self.template_cells, self.template_cells),
                "started": (1,),
            },
            reset_interval=self.reset_interval,
        )


class LiteState(NamedTuple):
    """Recurrent state of N objects; all zeros before the first forward pass."""

    lstm1_output: Tensor  # [N, units]
    lstm1_cell: Tensor  # [N, units]
    lstm2_output: Tensor  # [N, units]
    lstm2_cell: Tensor  # [N, units]
    template: Tensor  # [N, embedding, cells, cells]: the object in the first frame
    started: Tensor  # [N, 1]: 0 before the first forward pass, 1 after it


class LiteOutput(NamedTuple):
    """What the head says of N crops."""

    corners: Tensor  # [N, 4]: x1, y1, x2, y2 in the current crop, times REGRESSION_SCALE
    score_logit: Tensor  # [N]: sigmoid of it is the expected overlap
    heat_logits: Tensor  # [N, 2, G, G]: top-left and bottom-right corner


class ChannelNorm(nn.Module):
    """Each position's channels to zero mean and unit variance, then scaled and shifted."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels, 1, 1))
        self.bias = nn.Parameter(torch.zeros(channels, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        centred = x - x.mean(dim=1, keepdim=True)
        variance = (centred * centred).mean(dim=1, keepdim=True)
        return centred * torch.rsqrt(variance + 1e-5) * self.weight + self.bias


class Embedding(nn.Module):
    """Trunk maps at strides 4, 8, 16 to one map at stride 8 (skip connections, sec. III-A)."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        skip4, skip8, skip16 = config.skips
        self.skip4 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[4], skip4, 2, stride=2), nn.PReLU(skip4))
        self.skip8 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[8], skip8, 1), nn.PReLU(skip8))
        self.skip16 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[16], skip16, 1), nn.PReLU(skip16))
        self.merge = nn.Conv2d(sum(config.skips), config.embedding, 1)
        self.norm = ChannelNorm(config.embedding)

    def forward(self, features: Features) -> Tensor:
        """Trunk maps of N crops of S pixels to `[N, embedding, S / 8, S / 8]`."""
        at4, at8, at16 = features
        wide = nn.functional.interpolate(self.skip16(at16), scale_factor=2.0, mode="nearest")
        return self.norm(self.merge(torch.cat([self.skip4(at4), self.skip8(at8), wide], dim=1)))


class Correlation(nn.Module):
    """Every template position against every position of the current embedding."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        positions = config.template_cells**2
        self.scale = config.embedding**-0.5
        self.reduce = nn.Sequential(
            nn.Conv2d(positions, config.correlation, 1), nn.PReLU(config.correlation)
        )

    def forward(self, template: Tensor, current: Tensor) -> Tensor:
        """`[N, C, K, K]` and `[N, C, G, G]` to `[N, correlation, G, G]`."""
        n, _, side, _ = current.shape
        keys = template.flatten(2).transpose(1, 2)  # [N, K * K, C]
        values = torch.bmm(keys, current.flatten(2)) * self.scale  # [N, K * K, G * G]
        return self.reduce(values.reshape(n, -1, side, side))


class LiteHead(nn.Module):
    """Everything after the trunk: embeddings, correlation, recurrence, readout."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        self.config = config
        fused, units = config.fused, config.lstm_units
        grid = config.current.size // STRIDE
        self.embedding = Embedding(config)
        self.correlate_previous = Correlation(config)
        self.correlate_first = Correlation(config)
        self.fuse = nn.Sequential(
            nn.Conv2d(config.embedding + 2 * config.correlation, fused, 1),
            nn.PReLU(fused),
            nn.Conv2d(fused, fused, 3, padding=1),
            nn.PReLU(fused),
            nn.Conv2d(fused, fused, 3, padding=1),
            nn.PReLU(fused),
        )
        self.squeeze = nn.Sequential(
            nn.Conv2d(fused, fused // 2, 3, stride=2, padding=1), nn.PReLU(fused // 2)
        )
        pooled = (config.previous.size // STRIDE // 4) ** 2 * config.embedding
        self.fully_connected = nn.Sequential(
            nn.Linear((grid // 2) ** 2 * (fused // 2) + pooled, config.fully_connected), nn.ReLU()
        )
        self.lstm = FactoredLSTM(config.fully_connected, units)
        self.modulate = nn.Linear(units, 2 * fused)
        self.refine = nn.Sequential(nn.Conv2d(fused, fused, 3, padding=1), nn.PReLU(fused))
        self.heat = nn.Conv2d(fused, 2, 1)
        self.residual = nn.Linear(units, 4)
        self.score = nn.Sequential(
            nn.Linear(units + 2 * fused + 2, 64), nn.ReLU(), nn.Linear(64, 1)
        )
        centres = (torch.arange(grid) + 0.5) / grid * REGRESSION_SCALE
        self.register_buffer("centres", centres, persistent=False)
        self._initialise()

    def _initialise(self) -> None:
        """MSRA for all new layers (sec. III-C); readouts start silent."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d | nn.Linear):
                nn.init.kaiming_normal_(module.weight)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        for readout in (self.modulate, self.residual):
            nn.init.zeros_(readout.weight)
        nn.init.normal_(self.heat.weight, std=0.01)

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> LiteState:
        """The state of so many objects before their first forward pass."""
        shapes = self.config.spec().state
        return LiteState(**{k: torch.zeros(objects, *s, device=device) for k, s in shapes.items()})

    def object_part(self, embedding: Tensor) -> Tensor:
        """The middle of the previous crop's embedding, where the object is."""
        cells = self.config.template_cells
        start = (embedding.shape[-1] - cells) // 2
        return embedding[:, :, start : start + cells, start : start + cells]

    def look(self, previous: Tensor, current: Tensor, template: Tensor) -> tuple[Tensor, Tensor]:
        """What does not depend on the recurrent state.

        Args:
            previous, current: embeddings of the two crops.
            template: `[N, C, K, K]`, of the first frame.

        Returns:
            the fused map `[N, fused, G, G]` and the visual features `[N, fully_connected]`.
        """
        fused = self.fuse(
            torch.cat(
                [
                    current,
                    self.correlate_previous(self.object_part(previous), current),
                    self.correlate_first(template, current),
                ],
                dim=1,
            )
        )
        pooled = nn.functional.avg_pool2d(previous, 4)
        both = torch.cat([self.squeeze(fused).flatten(1), pooled.flatten(1)], dim=1)
        return fused, self.fully_connected(both)

    def read(self, fused: Tensor, recurrent: Tensor) -> LiteOutput:
        """Fused map `[N, fused, G, G]` and LSTM output `[N, units]` to corners and score."""
        scale, shift = self.modulate(recurrent)[:, :, None, None].chunk(2, dim=1)
        refined = self.refine(fused * (1 + scale) + shift)
        logits = self.heat(refined)
        heat = logits.flatten(2).softmax(dim=2).unflatten(2, logits.shape[2:])  # [N, 2, G, G]
        x = (heat.sum(dim=2) * self.centres).sum(dim=2)  # [N, 2]
        y = (heat.sum(dim=3) * self.centres).sum(dim=2)
        corners = torch.stack([x[:, 0], y[:, 0], x[:, 1], y[:, 1]], dim=1)
        evidence = torch.cat(
            [
                recurrent,
                refined.mean(dim=(2, 3)),
                refined.amax(dim=(2, 3)),
                torch.log(heat.amax(dim=(2, 3)) + 1e-6),
            ],
            dim=1,
        )
        return LiteOutput(
            corners=corners + self.residual(recurrent),
            score_logit=self.score(evidence)[:, 0],
            heat_logits=logits,
        )

    def forward(
        self, previous: Features, current: Features, state: LiteState
    ) -> tuple[LiteOutput, LiteState]:
        """One step of N objects from trunk maps; the state goes in and comes out."""
        previous_map, current_map = self.embedding(previous), self.embedding(current)
        started = state.started[:, :, None, None]
        template = started * state.template + (1 - started) * self.object_part(previous_map)
        fused, features = self.look(previous_map, current_map, template)
        recurrent, (first, second) = self.lstm(
            features,
            (
                CellState(state.lstm1_output, state.lstm1_cell),
                CellState(state.lstm2_output, state.lstm2_cell),
            ),
        )
        new_state = LiteState(
            lstm1_output=first.output,
            lstm1_cell=first.cell,
            lstm2_output=second.output,
            lstm2_cell=second.cell,
            template=template,
            started=torch.ones_like(state.started),
        )
        return self.read(fused, recurrent), new_state

    def unroll(self, previous: Features, current: Features, steps: int) -> LiteOutput:
        """All steps of fresh tracks at once; equals `forward` step by step from the zero state.

        Only the LSTM runs step by step, everything else over all steps in one batch.

        Args:
            previous, current: trunk maps `[steps * N, ...]`, step-major; step 0 is the
                initialisation frame.
            steps: number of steps.

        Returns:
            output for `[steps * N]`, step-major.
        """
        previous_map, current_map = self.embedding(previous), self.embedding(current)
        objects = len(previous_map) // steps
        template = self.object_part(previous_map[:objects]).repeat(steps, 1, 1, 1)
        fused, features = self.look(previous_map, current_map, template)
        zero = features.new_zeros(objects, self.config.lstm_units)
        state = (CellState(zero, zero), CellState(zero, zero))
        outputs = []
        for step in range(steps):
            output, state = self.lstm(features[step * objects : (step + 1) * objects], state)
            outputs.append(output)
        return self.read(fused, torch.cat(outputs))


class Re3Lite(nn.Module):
    """Trunk and head: two batches of crops and a state in, corners, score and state out."""

    def __init__(self, config: LiteConfig | None = None) -> None:
        super().__init__()
        self.config = config or LiteConfig()
        self.trunk = EfficientNetLite0()
        self.head = LiteHead(self.config)

    def spec(self) -> ModelSpec:
        """What a tracker must know to drive this network."""
        return self.config.spec()

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> LiteState:
        """The state of so many objects before their first forward pass."""
        return self.head.zero_state(objects, device)

    def features(self, crops: Tensor) -> Features:
        """Trunk maps of uint8 `[N, S, S, 3]` BGR crops."""
        return self.trunk(crops.permute(0, 3, 1, 2).float() - PIXEL_MEAN)

    def forward(
        self, previous_crops: Tensor, current_crops: Tensor, state: LiteState
    ) -> tuple[Tensor, Tensor, LiteState]:
        """One step of N objects.

        Args:
            previous_crops, current_crops: uint8 `[N, S, S, 3]`, BGR, each of its own size.
            state: of the step before; `head.zero_state(N)` for the first.

        Returns:
            corners `[N, 4]` in the current crop times `REGRESSION_SCALE`, expected overlap `[N]`
            in 0..1, and the new state.
        """
        output, new_state = self.head(
            self.features(previous_crops), self.features(current_crops), state
        )
        return output.corners, torch.sigmoid(output.score_logit), new_state
