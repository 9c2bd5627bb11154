"""A network that looks at every crop as it is and mirrored: `re3-base`.

The rule is that of `re3.engine.mirrored`, which tracks so with any network; here it is part of the
network, to be exported as one graph.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from re3.geometry import REGRESSION_SCALE
from re3.mirroring import LOOKS, NO_SCORE, SHARPNESS, mirrored_spec
from re3.model_spec import ModelSpec
from re3.network.base import StepNetwork
from re3.network.lite_config import LiteConfig

LOOK = LiteConfig(name="re3-look", lean=False)
"""One look of `re3-base`: `re3-lite` but for what makes that lean, with weights of its own."""


@dataclass(frozen=True)
class MirroredConfig:
    """Which network looks twice.

    Attributes:
        name: of the two together.
        once: of one look.
    """

    name: str = "re3-base"
    once: LiteConfig = LOOK

    def spec(self) -> ModelSpec:
        return mirrored_spec(self.once.spec(), self.name)


class Mirrored(StepNetwork):
    """Two looks of one network, each with a state of its own, and the mean of what they find.

    Args:
        once: the network.
        name: of the two together.
    """

    def __init__(self, once: StepNetwork, name: str) -> None:
        super().__init__()
        self.once, self.name = once, name

    @property
    def trunk(self) -> nn.Module:  # type: ignore[override]
        """The convolutions, which both looks share."""
        return self.once.trunk

    def spec(self) -> ModelSpec:
        """What a tracker must know to drive this network."""
        return mirrored_spec(self.once.spec(), self.name)

    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> Any:
        """The state of so many objects before their first forward pass, `[N, 2, ...]` each."""
        return type(self.once.zero_state(1))(*self._zeros(objects, device))

    def forward(self, *inputs: Any) -> tuple[Tensor, Tensor, Any]:
        """One step: crops and state as `once` takes them, but for the shape of the state.

        Returns:
            corners `[N, 4]` in the crop as it is, expected overlap `[N]`, and the new state.
        """
        *crops, state = inputs
        kind = type(state)
        corners, score, after = self.once(
            *(_one_by_one(torch.stack([crop, crop.flip(2)], dim=1)) for crop in crops),
            kind(*(_one_by_one(part) for part in state)),
        )
        found = _in_pairs(corners)
        left, top, right, bottom = found[:, 1].unbind(dim=1)
        turned = [REGRESSION_SCALE - right, top, REGRESSION_SCALE - left, bottom]
        both = torch.stack([found[:, 0], torch.stack(turned, dim=1)], dim=1)
        scores = _in_pairs(score)
        some = scores.clamp(min=NO_SCORE)
        power = (some / some.amax(dim=1, keepdim=True)) ** SHARPNESS
        share = power / power.sum(dim=1, keepdim=True)
        return (
            (both * share[:, :, None]).sum(dim=1),
            (scores * share).sum(dim=1),
            kind(*(_in_pairs(part) for part in after)),
        )


def _one_by_one(x: Tensor) -> Tensor:
    """`[N, 2, ...]` to `[2 * N, ...]`."""
    return x.reshape(-1, *(int(side) for side in x.shape[2:]))


def _in_pairs(x: Tensor) -> Tensor:
    """`[2 * N, ...]` to `[N, 2, ...]`."""
    return x.reshape(-1, LOOKS, *(int(side) for side in x.shape[1:]))
