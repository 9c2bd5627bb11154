"""Recipes for training from packed data, as values."""

from __future__ import annotations

import math
from dataclasses import dataclass

from re3.training.recipe import CropNoise, LossWeights


@dataclass(frozen=True)
class Stage:
    """A part of a run at one unroll length.

    Attributes:
        until: share of the run, above 0 to 1, at which it ends.
        unroll: steps after the initialisation frame.
        batch: clips in a batch.
        own: probability, for each clip, of crops at the network's own predictions.
    """

    until: float
    unroll: int
    batch: int
    own: float

    def __post_init__(self) -> None:
        if min(self.unroll, self.batch) < 1 or not (0 < self.until <= 1 and 0 <= self.own <= 1):
            raise ValueError(
                f"{self} is not usable; expected unroll and batch of 1 or more, until above 0 and "
                "up to 1, and a probability own in 0..1"
            )


@dataclass(frozen=True)
class PackedRecipe:
    """What decides a run but data and network.

    The learning rate rises from 0 over the first `warm_up` of the run and then falls along a
    cosine.

    Attributes:
        stages: in order; the last one is until 1.
        learning_rate, final_learning_rate: highest, and at the end.
        backbone_rate: share of the learning rate at which the backbone learns.
        warm_up: share of the run.
        weight_decay: of AdamW.
        gradient_norm: gradients are clipped to this norm.
        average: decay per iteration of the exponential moving average of the weights.
        seed: of data and noise.
        noise: disturbance of the crops.
        loss: weights of the loss terms.
    """

    stages: tuple[Stage, ...] = (Stage(until=1.0, unroll=8, batch=128, own=0.6),)
    learning_rate: float = 5e-4
    final_learning_rate: float = 5e-6
    backbone_rate: float = 0.4
    warm_up: float = 0.03
    weight_decay: float = 1e-3
    gradient_norm: float = 2.0
    average: float = 0.997
    seed: int = 0
    noise: CropNoise = CropNoise(jump=0.25, jump_limit=1.5, jumps_own=0.1)
    loss: LossWeights = LossWeights()

    def __post_init__(self) -> None:
        ends = [stage.until for stage in self.stages]
        if not ends or ends[-1] != 1.0 or ends != sorted(set(ends)):
            raise ValueError(f"the stages end at {ends}; expected shares of the run that rise to 1")
        if not 0 < self.final_learning_rate <= self.learning_rate:
            raise ValueError(
                f"learning rates {self.learning_rate} to {self.final_learning_rate}; expected the "
                "final one above 0 and not above the first"
            )
        if not (0 < self.backbone_rate <= 1 and 0 <= self.warm_up < 1 and 0 <= self.average < 1):
            raise ValueError(
                f"backbone_rate is {self.backbone_rate}, warm_up {self.warm_up} and average "
                f"{self.average}; expected a share above 0 and up to 1, and two from 0 to below 1"
            )

    def stage_at(self, progress: float) -> Stage:
        """The stage at a share of the run, 0 to 1."""
        return next(stage for stage in self.stages if progress < stage.until or stage.until == 1.0)

    def rate_at(self, progress: float) -> float:
        """The learning rate at a share of the run, 0 to 1."""
        if progress < self.warm_up:
            return self.learning_rate * max(progress / self.warm_up, 1e-3)
        share = min((progress - self.warm_up) / (1 - self.warm_up), 1.0)
        span = self.learning_rate - self.final_learning_rate
        return self.final_learning_rate + span * 0.5 * (1 + math.cos(math.pi * share))


GPU = PackedRecipe()
"""For some minutes on one GPU, from weights of `re3-lite` or of another size of it."""

PACKED_RECIPES = {"gpu": GPU}
"""The recipes by name."""
