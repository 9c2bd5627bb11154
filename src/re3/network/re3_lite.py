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

from typing import NamedTuple

import torch
from torch import Tensor, nn

from re3.model_spec import ModelSpec
from re3.network.base import Maps, Prediction, Seen, TrackingNetwork
from re3.network.efficientnet_lite import FIRST_SPLIT, PIXEL_MEAN, STAGES, EfficientNetLite0
from re3.network.lite_blocks import Features
from re3.network.lite_config import LiteConfig, LiteState
from re3.network.lite_head import LiteHead


def _centred(crops: Tensor) -> Tensor:
    return crops.permute(0, 3, 1, 2).float() - PIXEL_MEAN


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
        self.outline_cells = self.config.grid

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
        """Of EfficientNet-Lite0, those after stride 4 can."""
        most = len(STAGES) - FIRST_SPLIT
        if not 0 <= stages <= most:
            raise ValueError(
                f"{stages} stages of the trunk are to learn; expected 0 to {most}, those after "
                "stride 4, or learn_trunk for all"
            )
        self.split = len(STAGES) - stages
        for index, stage in enumerate(self.trunk.stages):
            stage.requires_grad_(index >= self.split)

    @staticmethod
    def centred(crops: Tensor) -> Tensor:
        """Crops `[N, S, S, 3]` BGR, 0 to 255, as the backbone takes them: `[N, 3, S, S]`."""
        return _centred(crops)

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
        return Prediction(
            output.corners, output.score_logit, output.heat_logits, output.outline_logits
        )

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
