"""`re3-lite`: Re3's recurrent regression sized for a CPU, its regression made spatial.

Kept from the paper: the previous and the current frame seen together, shared convolutions with skip
connections through 1x1 convolutions and PReLU, one fully connected layer, a two-layer factored
peephole LSTM whose state is the model of the object, corners in crop coordinates under an L1 loss.

Changed: the previous frame is not cut and convolved again; what the network saw of it is taken from
the embedding of one step ago, about the box found there, and carried in the state. The object part
of that view, and of the very first one, is correlated with the current crop; the fused map is read
out as two heat maps (top-left and bottom-right corner), whose channels the LSTM's output scales and
shifts; the current crop reaches further than the view of the previous frame, for fast motion. A
head predicts the overlap of the box with the object, from what it finds inside the box among
others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from re3.geometry import REGRESSION_SCALE
from re3.model_spec import CropSpec, ModelSpec
from re3.network.base import Maps, Prediction, Seen, TrackingNetwork
from re3.network.efficientnet_lite import (
    FIRST_SPLIT,
    OUT_CHANNELS,
    PIXEL_MEAN,
    STAGES,
    EfficientNetLite0,
)
from re3.network.peephole_lstm import CellState, FactoredLSTM

STRIDE = 8
"""Stride of the embedding's grid."""

SMALLEST_VIEW = 0.02
"""Least side of a box that is viewed, in units of the crop: a network gone astray gives less."""

Features = tuple[Tensor, Tensor, Tensor]
"""Trunk maps of one crop at strides 4, 8 and 16."""


@dataclass(frozen=True)
class LiteConfig:
    """Sizes of a `re3-lite` variant; channels unless said otherwise.

    Attributes:
        current: crop of the current frame.
        view: side of the view of the previous frame in units of the box's side (the paper's
            padding). Its middle, the object, is the template.
        skips: outputs of the skip connections from strides 4, 8 and 16 (sec. III-A).
        embedding: of a crop's embedding.
        adapter: inside the blocks that fit the trunk's maps to tracking.
        correlation: kept of each correlation.
        fused: of the fused map.
        fully_connected: units of the fully connected layer.
        lstm_units: units of each LSTM cell.
        reset_interval: steps between two resets of the recurrent state.
    """

    name: str = "re3-lite"
    current: CropSpec = CropSpec(context=3.0, size=192)
    view: float = 2.0
    skips: tuple[int, int, int] = (16, 32, 64)
    embedding: int = 64
    adapter: int = 64
    correlation: int = 48
    fused: int = 64
    fully_connected: int = 384
    lstm_units: int = 256
    reset_interval: int = 32

    def __post_init__(self) -> None:
        if self.current.size % 16:
            raise ValueError(
                f"crop size {self.current.size} is not a multiple of the trunk's stride 16"
            )
        if not 1.0 <= self.view <= self.current.context:
            raise ValueError(
                f"the view is {self.view} boxes wide; expected 1 or more, and no more than the "
                f"current crop's {self.current.context}"
            )

    @property
    def grid(self) -> int:
        """Side of a current crop's embedding."""
        return self.current.size // STRIDE

    @property
    def view_cells(self) -> int:
        """Side of the view of the previous frame, at the current crop's pixels per object."""
        return round(self.current.size / self.current.context * self.view / STRIDE)

    @property
    def template_cells(self) -> int:
        """Side of the template: the object's part of a view."""
        return round(self.view_cells / self.view)

    def spec(self) -> ModelSpec:
        units = self.lstm_units
        return ModelSpec(
            name=self.name,
            previous=None,
            current=self.current,
            fill=(PIXEL_MEAN, PIXEL_MEAN, PIXEL_MEAN),
            state={
                **dict.fromkeys(FactoredLSTM.STATE_NAMES, (units,)),
                "template": (self.embedding, self.template_cells, self.template_cells),
                "view": (self.embedding, self.view_cells, self.view_cells),
                "started": (1,),
            },
            kept_at_reset=("view",),
            reset_interval=self.reset_interval,
        )


class LiteState(NamedTuple):
    """Recurrent state of N objects; all zeros before the first forward pass."""

    lstm1_output: Tensor  # [N, units]
    lstm1_cell: Tensor  # [N, units]
    lstm2_output: Tensor  # [N, units]
    lstm2_cell: Tensor  # [N, units]
    template: Tensor  # [N, embedding, cells, cells]: the object in the first frame
    view: Tensor  # [N, embedding, cells, cells]: about the box in the previous frame
    started: Tensor  # [N, 1]: 0 before the first forward pass, 1 after it


class LiteOutput(NamedTuple):
    """What the head says of N crops."""

    corners: Tensor  # [N, 4]: x1, y1, x2, y2 in the current crop, times REGRESSION_SCALE
    score_logit: Tensor  # [N]: sigmoid of it is the expected overlap
    heat_logits: Tensor  # [N, 2, G, G]: top-left and bottom-right corner
    view: Tensor  # [N, C, V, V]: embedding about the box found


class ChannelNorm(nn.Module):
    """Each position's channels to zero mean and unit variance, then scaled and shifted."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels, 1, 1))
        self.bias = nn.Parameter(torch.zeros(channels, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        weight, bias = self.weight.flatten(), self.bias.flatten()
        channels_last = x.permute(0, 2, 3, 1)
        normed = nn.functional.layer_norm(channels_last, weight.shape, weight, bias)
        return normed.permute(0, 3, 1, 2)


class Adapter(nn.Module):
    """Adds to a map what three convolutions make of it.

    The trunk was trained to tell kinds of things apart, and most of it stays as it is; these blocks
    learn what tells one thing from the next of its kind.
    """

    def __init__(self, channels: int, inside: int) -> None:
        super().__init__()
        self.change = nn.Sequential(
            nn.Conv2d(channels, inside, 1),
            nn.PReLU(inside),
            nn.Conv2d(inside, inside, 3, padding=1),
            nn.PReLU(inside),
        )
        self.contract = nn.Conv2d(inside, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        changed: Tensor = x + self.contract(self.change(x))
        return changed


class Embedding(nn.Module):
    """Trunk maps at strides 4, 8, 16 to one map at stride 8 (skip connections, sec. III-A)."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        skip4, skip8, skip16 = config.skips
        self.adapt16 = nn.Sequential(
            Adapter(OUT_CHANNELS[16], config.adapter), Adapter(OUT_CHANNELS[16], config.adapter)
        )
        self.skip4 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[4], skip4, 2, stride=2), nn.PReLU(skip4))
        self.skip8 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[8], skip8, 1), nn.PReLU(skip8))
        self.skip16 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[16], skip16, 1), nn.PReLU(skip16))
        self.merge = nn.Conv2d(sum(config.skips), config.embedding, 1)
        self.adapt8 = Adapter(config.embedding, config.adapter // 2)
        self.norm = ChannelNorm(config.embedding)

    def forward(self, features: Features) -> Tensor:
        """Trunk maps of N crops to `[N, embedding, G, G]`."""
        at4, at8, at16 = features
        adapted = self.adapt16(at16)
        wide = nn.functional.interpolate(self.skip16(adapted), scale_factor=2.0, mode="nearest")
        merged = self.merge(torch.cat([self.skip4(at4), self.skip8(at8), wide], dim=1))
        embedding: Tensor = self.norm(self.adapt8(merged))
        return embedding


def sample_region(maps: Tensor, regions: Tensor, cells: int) -> Tensor:
    """Maps resampled over a region each, linearly; averaged where the region is the coarser.

    Two matrix products: every engine has them, and the region's edges lie along the grid's.

    Args:
        maps: `[N, C, G, G]`.
        regions: `[N, 4]`, x1, y1, x2, y2 with the map over 0..1; outside of it there is zero.
        cells: side of the result.

    Returns:
        `[N, C, cells, cells]`.
    """
    side = int(maps.shape[-1])
    centres = torch.arange(0.5, side, dtype=maps.dtype, device=maps.device)
    steps = torch.arange(0.5, cells, dtype=maps.dtype, device=maps.device)[:, None] / cells
    low, high = (regions.reshape(-1, 4, 1, 1) * side).split(2, dim=1)  # [N, x and y, 1, 1]
    extent = high - low
    reach = (extent * (1 / cells)).clamp(min=1.0)
    distance = (low + extent * steps - centres).abs()  # [N, x and y, cells, G]
    across, down = ((reach - distance).clamp(min=0) / (reach * reach)).split(1, dim=1)
    return down @ (maps @ across.transpose(2, 3))


class Correlation(nn.Module):
    """Every template position against every position of the current embedding."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        self.positions = config.template_cells**2
        self.scale = config.embedding**-0.5
        self.reduce = nn.Sequential(
            nn.Conv2d(self.positions, config.correlation, 1), nn.PReLU(config.correlation)
        )

    def forward(self, template: Tensor, current: Tensor) -> Tensor:
        """`[N, C, K, K]` and `[N, C, G, G]` to `[N, correlation, G, G]`."""
        channels, side = (int(length) for length in current.shape[1:3])
        keys = template.reshape(-1, channels, self.positions).transpose(1, 2)
        maps = current.reshape(-1, channels, side * side)
        values = torch.bmm(keys, maps) * self.scale  # [N, K * K, G * G]
        return self.reduce(values.reshape(-1, self.positions, side, side))


class LiteHead(nn.Module):
    """Everything after the trunk: embeddings, correlation, recurrence, readout."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        self.config = config
        fused, units = config.fused, config.lstm_units
        grid = config.grid
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
        pooled = (config.view_cells // 4) ** 2 * config.embedding
        self.fully_connected = nn.Sequential(
            nn.Linear((grid // 2) ** 2 * (fused // 2) + pooled, config.fully_connected), nn.ReLU()
        )
        self.lstm = FactoredLSTM(config.fully_connected, units)
        self.modulate = nn.Linear(units, 2 * fused)
        self.refine = nn.Sequential(nn.Conv2d(fused, fused, 3, padding=1), nn.PReLU(fused))
        self.heat = nn.Conv2d(fused, 2, 1)
        self.residual = nn.Linear(units, 4)
        likeness = 2 * config.template_cells**2
        self.score = nn.Sequential(
            nn.Linear(units + 2 * fused + 2 + 4 + likeness, 64), nn.ReLU(), nn.Linear(64, 1)
        )
        centres = (torch.arange(grid) + 0.5) / grid * REGRESSION_SCALE
        x_and_y = torch.stack(torch.meshgrid(centres, centres, indexing="xy"), dim=2)
        self.register_buffer("centres", x_and_y.reshape(-1, 2), persistent=False)
        self._initialise()

    def _initialise(self) -> None:
        """MSRA for all new layers (sec. III-C); readouts and adapters start silent."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d | nn.Linear):
                nn.init.kaiming_normal_(module.weight)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        for readout in (self.modulate, self.residual):
            nn.init.zeros_(readout.weight)
        for module in self.modules():
            if isinstance(module, Adapter):
                nn.init.zeros_(module.contract.weight)
        nn.init.normal_(self.heat.weight, std=0.01)

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> LiteState:
        """The state of so many objects before their first forward pass."""
        shapes = self.config.spec().state
        return LiteState(**{k: torch.zeros(objects, *s, device=device) for k, s in shapes.items()})

    def view(self, embedding: Tensor, corners: Tensor) -> Tensor:
        """The embedding about boxes found in it: what the next step knows of this frame.

        Args:
            embedding: `[N, C, G, G]` of current crops.
            corners: `[N, 4]` of the boxes in those crops, regression units.

        Returns:
            `[N, C, V, V]`, `LiteConfig.view` times as wide as the box.
        """
        low, high = (corners * (0.5 / REGRESSION_SCALE)).split(2, dim=1)
        middle = low + high
        half = (high - low).clamp(min=SMALLEST_VIEW / 2) * self.config.view
        regions = torch.cat([middle - half, middle + half], dim=1)
        return sample_region(embedding, regions, self.config.view_cells)

    def first_view(self, embedding: Tensor) -> Tensor:
        """The view of the first frame, where the box is the one that the crop was cut about."""
        return _middle(embedding, self.config.view_cells)

    def object_part(self, view: Tensor) -> Tensor:
        """The middle of a view, where the object is."""
        return _middle(view, self.config.template_cells)

    def look(self, view: Tensor, embedding: Tensor, template: Tensor) -> tuple[Tensor, Tensor]:
        """What does not depend on the recurrent state.

        Args:
            view: of the previous frame, `[N, C, V, V]`.
            embedding: of the current crop, `[N, C, G, G]`.
            template: `[N, C, K, K]`, of the first frame.

        Returns:
            the fused map `[N, fused, G, G]` and the visual features `[N, fully_connected]`.
        """
        fused = self.fuse(
            torch.cat(
                [
                    embedding,
                    self.correlate_previous(self.object_part(view), embedding),
                    self.correlate_first(template, embedding),
                ],
                dim=1,
            )
        )
        pooled = nn.functional.avg_pool2d(view, 4)
        both = torch.cat([self.squeeze(fused).flatten(1), pooled.flatten(1)], dim=1)
        return fused, self.fully_connected(both)

    def read(
        self, fused: Tensor, recurrent: Tensor, view: Tensor, embedding: Tensor, template: Tensor
    ) -> LiteOutput:
        """Corners and score from the LSTM's output `[N, units]` and what `look` saw and gave."""
        modulation = self.modulate(recurrent).reshape(-1, 2 * self.config.fused, 1, 1)
        scale, shift = modulation.split(self.config.fused, dim=1)
        refined = self.refine(fused * (1 + scale) + shift)
        logits = self.heat(refined)
        heat = logits.reshape(-1, 2, self.config.grid**2).softmax(dim=2)  # [N, 2, G * G]
        corners = (heat @ self.centres).reshape(-1, 4) + self.residual(recurrent)
        found = self.view(embedding, corners.detach())
        inside = self.object_part(found)
        evidence = torch.cat(
            [
                recurrent,
                refined.mean(dim=(2, 3)),
                refined.amax(dim=(2, 3)),
                torch.log(heat.amax(dim=2) + 1e-6),
                corners.detach() * (1 / REGRESSION_SCALE),
                (inside * template).mean(dim=1).flatten(1),
                (inside * self.object_part(view)).mean(dim=1).flatten(1),
            ],
            dim=1,
        )
        return LiteOutput(corners, self.score(evidence)[:, 0], logits, found)

    def forward(self, embedding: Tensor, state: LiteState) -> tuple[LiteOutput, LiteState]:
        """One step of N objects from their crops' embeddings; the state goes in and comes out."""
        started = state.started.reshape(-1, 1, 1, 1)
        begins = 1 - started  # what is remembered is zero then
        view = state.view + begins * self.first_view(embedding)
        template = state.template + begins * self.object_part(view)
        fused, features = self.look(view, embedding, template)
        recurrent, (first, second) = self.lstm(
            features,
            (
                CellState(state.lstm1_output, state.lstm1_cell),
                CellState(state.lstm2_output, state.lstm2_cell),
            ),
        )
        output = self.read(fused, recurrent, view, embedding, template)
        new_state = LiteState(
            lstm1_output=first.output,
            lstm1_cell=first.cell,
            lstm2_output=second.output,
            lstm2_cell=second.cell,
            template=template,
            # In the first frame the box given counts, not the one found.
            view=started * output.view + begins * view,
            started=state.started.clamp(min=1),
        )
        return output, new_state

    def unroll(self, embedding: Tensor, looked: Tensor, steps: int) -> LiteOutput:
        """All steps of fresh tracks at once; equals `forward` step by step from the zero state.

        Only the LSTM runs step by step, everything else over all steps in one batch.

        Args:
            embedding: of the current crops, `[steps * N, C, G, G]`, step-major; step 0 is the
                initialisation frame.
            looked: `[steps * N, 4]`, the box of the frame before about which each step's crop was
                cut, in the crop of the step before, regression units; unused for step 0.
            steps: number of steps.

        Returns:
            output for `[steps * N]`, step-major.
        """
        objects = len(embedding) // steps
        first = self.first_view(embedding[:objects])
        view = torch.cat([first, self.view(embedding[:-objects], looked[objects:])])
        template = self.object_part(first).repeat(steps, 1, 1, 1)
        fused, features = self.look(view, embedding, template)
        with torch.autocast(fused.device.type, enabled=False):
            # What adds up over steps or cells loses its last pixels in 16 bits.
            recurrent = self._recur(features.float(), objects)
            seen = (view.float(), embedding.float(), template.float())
            return self.read(fused.float(), recurrent, *seen)

    def _recur(self, features: Tensor, objects: int) -> Tensor:
        """The LSTM's output `[steps * N, units]` from the visual features of fresh tracks."""
        zero = features.new_zeros(objects, self.config.lstm_units)
        state = (CellState(zero, zero), CellState(zero, zero))
        outputs = []
        for step in features.split(objects):
            output, state = self.lstm(step, state)
            outputs.append(output)
        return torch.cat(outputs)


def _centred(crops: Tensor) -> Tensor:
    return crops.permute(0, 3, 1, 2).float() - PIXEL_MEAN


def _middle(maps: Tensor, cells: int) -> Tensor:
    start = (int(maps.shape[-1]) - cells) // 2
    return maps[:, :, start : start + cells, start : start + cells]


class LiteMemory(NamedTuple):
    """What a step of a roll-out leaves for the next."""

    state: LiteState
    embedding: Tensor  # [N, C, G, G]: of the current crop


class Re3Lite(TrackingNetwork):
    """Trunk and head: a batch of crops and a state in, corners, score and state out.

    Attributes:
        split: stages of the trunk in `features`; the others learn with the head.
    """

    trunk: EfficientNetLite0

    def __init__(self, config: LiteConfig | None = None) -> None:
        super().__init__()
        self.config = config or LiteConfig()
        self.trunk = EfficientNetLite0()
        self.head = LiteHead(self.config)
        self.split = len(STAGES)

    def spec(self) -> ModelSpec:
        """What a tracker must know to drive this network."""
        return self.config.spec()

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> LiteState:
        """The state of so many objects before their first forward pass."""
        return self.head.zero_state(objects, device)

    def parts(self) -> dict[str, nn.Module]:
        """The parts of the head, by name."""
        return dict(self.head.named_children())

    def let_trunk_learn(self, stages: int) -> None:
        """Of EfficientNet-Lite0, those after stride 8 can."""
        most = len(STAGES) - FIRST_SPLIT
        if not 0 <= stages <= most:
            raise ValueError(
                f"{stages} stages of the trunk are to learn; expected 0 to {most}, those after "
                f"stride {STRIDE}, or learn_trunk for all"
            )
        self.split = len(STAGES) - stages
        for index, stage in enumerate(self.trunk.stages):
            stage.requires_grad_(index >= self.split)

    def features(self, crops: Tensor) -> Features:
        """Trunk maps of uint8 `[N, S, S, 3]` BGR crops."""
        return self.trunk.begin(_centred(crops), self.split)

    def _embedding(self, maps: Maps) -> Tensor:
        at4, at8, last = maps
        embedding: Tensor = self.head.embedding(self.trunk.finish((at4, at8, last), self.split))
        return embedding

    def walk(self, seen: Seen, memory: LiteMemory | None) -> tuple[Tensor, LiteMemory]:
        """One step of N tracks, which looks at the frame before about `seen.looked`."""
        embedding = self._embedding(seen.current)
        if memory is None:
            state = self.zero_state(len(embedding), embedding.device)
        else:
            state = memory.state._replace(view=self.head.view(memory.embedding, seen.looked))
        output, state = self.head(embedding, state)
        return output.corners, LiteMemory(state, embedding)

    def unroll(self, seen: Seen, steps: int) -> Prediction:
        """All steps of fresh tracks at once; see `LiteHead.unroll`."""
        output = self.head.unroll(self._embedding(seen.current), seen.looked, steps)
        return Prediction(output.corners, output.score_logit, output.heat_logits)

    def forward(self, crops: Tensor, state: LiteState) -> tuple[Tensor, Tensor, LiteState]:
        """One step of N objects.

        Args:
            crops: of the current frame, uint8 `[N, S, S, 3]`, BGR.
            state: of the step before; `head.zero_state(N)` for the first.

        Returns:
            corners `[N, 4]` in the current crop times `REGRESSION_SCALE`, expected overlap `[N]`
            in 0..1, and the new state.
        """
        output, new_state = self.head(self.head.embedding(self.trunk(_centred(crops))), state)
        return output.corners, torch.sigmoid(output.score_logit), new_state
