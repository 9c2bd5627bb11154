"""What the trainer, the exporter and the engines ask of a network."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from re3.model_spec import ModelSpec

Maps = tuple[Tensor, ...]
"""What the convolutions make of crops, each `[N, C, H, W]`."""


class Seen(NamedTuple):
    """What a network sees of N objects in a step; or in all steps, step-major `[steps * N, ...]`.

    Attributes:
        current: maps of the current crops.
        previous: maps of the previous crops; None for a network that takes none.
        looked: `[N, 4]`, the box of the frame before about which the current crop was cut, in the
            crop of the step before, regression units; says nothing in a track's first step.
    """

    current: Maps
    previous: Maps | None
    looked: Tensor


class Prediction(NamedTuple):
    """What a network says of N crops, as far as there is something to learn from it.

    Attributes:
        corners: `[N, 4]`, x1, y1, x2, y2 in the current crop, times `REGRESSION_SCALE`.
        score_logit: `[N]`, sigmoid of it is the expected overlap; None without a score.
        heat_logits: `[N, 2, G, G]`, of top-left and bottom-right corner; None without heat maps.
        outline_logits: `[N, G, G]`, sigmoid of it is the share of a cell that shows the object;
            None of a network that does not draw it.
    """

    corners: Tensor
    score_logit: Tensor | None = None
    heat_logits: Tensor | None = None
    outline_logits: Tensor | None = None


class StepNetwork(nn.Module, ABC):
    """A network that follows objects step by step, with its state passed in and out.

    `forward` is one step from crops, which is exported: the previous crops (of a network that takes
    any), the current crops and the state to corners, score and the new state.

    Attributes:
        trunk: the convolutions.
    """

    trunk: nn.Module

    @abstractmethod
    def spec(self) -> ModelSpec:
        """What a tracker must know to drive this network."""

    @abstractmethod
    def zero_state(self, objects: int, device: torch.device | str = "cpu") -> Any:
        """The state of so many objects before their first forward pass, a named tuple."""

    def _zeros(self, objects: int, device: torch.device | str) -> list[Tensor]:
        """The values of such a state, in the order of the specification."""
        return [torch.zeros(objects, *s, device=device) for s in self.spec().state.values()]


class TrackingNetwork(StepNetwork):
    """A network that can be trained: maps of crops once, then steps and unrolls from the maps.

    Attributes:
        outline_cells: side of the outlines that its part `outline` draws of the object, which it
            only learns from; 0 for none.
    """

    outline_cells: int = 0

    @abstractmethod
    def parts(self) -> dict[str, nn.Module]:
        """Everything but the pretrained convolutions, by name."""

    def let_trunk_learn(self, stages: int) -> None:
        """Leave the last stages of the trunk to `walk` and `unroll`, which gradients pass.

        Args:
            stages: how many; with 0 `features` is the whole trunk.

        Raises:
            ValueError: the trunk does not have so many, or none that can be run apart.
        """
        if stages:
            raise ValueError(
                f"{self.spec().name!r} has no stages of its trunk that learn apart from others; "
                "take 0 of them, or learn_trunk for all"
            )

    @abstractmethod
    def features(self, crops: Tensor) -> Maps:
        """Maps of uint8 `[N, S, S, 3]` BGR crops, previous or current; see `let_trunk_learn`."""

    @abstractmethod
    def walk(self, seen: Seen, memory: Any | None) -> tuple[Tensor, Any]:
        """One step of N tracks.

        Args:
            seen: in this step.
            memory: what the last step gave; None in a track's first.

        Returns:
            corners `[N, 4]`, and the memory for the next step.
        """

    @abstractmethod
    def unroll(self, seen: Seen, steps: int) -> Prediction:
        """All steps of fresh tracks at once; equals `walk` step by step."""
