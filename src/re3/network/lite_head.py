"""`re3-lite` behind its trunk: correlation with what was seen, recurrence, corners and score."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from re3.geometry import REGRESSION_SCALE
from re3.network.lite_blocks import Adapter, Correlation, Embedding, prelu, sample_region
from re3.network.lite_config import LiteConfig, LiteState
from re3.network.peephole_lstm import CellState, FactoredLSTM

SMALLEST_VIEW = 0.02
"""Least side of a box that is viewed, in units of the crop: a network gone astray gives less."""


class LiteOutput(NamedTuple):
    """What the head says of N crops."""

    corners: Tensor  # [N, 4]: x1, y1, x2, y2 in the current crop, times REGRESSION_SCALE
    score_logit: Tensor  # [N]: sigmoid of it is the expected overlap
    heat_logits: Tensor  # [N, 2, G, G]: top-left and bottom-right corner
    outline_logits: Tensor  # [N, G, G]: which cells show the object; learnt, never tracked with
    view: Tensor  # [N, C, V, V]: embedding about the box found


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
            prelu(config, fused),
            nn.Conv2d(fused, fused, 3, padding=1),
            prelu(config, fused),
            nn.Conv2d(fused, fused, 3, padding=1),
            prelu(config, fused),
        )
        self.squeeze = nn.Sequential(
            nn.Conv2d(fused, fused // 2, 3, stride=2, padding=1), prelu(config, fused // 2)
        )
        pooled = (config.view_cells // 4) ** 2 * config.embedding
        self.fully_connected = nn.Sequential(
            nn.Linear((grid // 2) ** 2 * (fused // 2) + pooled, config.fully_connected), nn.ReLU()
        )
        self.lstm = FactoredLSTM(config.fully_connected, units)
        self.modulate = nn.Linear(units, 2 * fused)
        self.refine = nn.Sequential(nn.Conv2d(fused, fused, 3, padding=1), prelu(config, fused))
        self.heat = nn.Conv2d(fused, 2, 1)
        self.residual = nn.Linear(units, 4)
        self.outline = nn.Conv2d(fused, 1, 1)
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
        for readout in (self.modulate, self.residual, self.outline):
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
        outline = self.outline(refined)[:, 0]
        return LiteOutput(corners, self.score(evidence)[:, 0], logits, outline, found)

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


def _middle(maps: Tensor, cells: int) -> Tensor:
    start = (int(maps.shape[-1]) - cells) // 2
    return maps[:, :, start : start + cells, start : start + cells]
