"""Training recipes: the curriculum and the optimiser's settings, as values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Phase:
    """A stretch of training at one unroll length (Re3, sec. III-B).

    Attributes:
        unroll: steps after the initialisation frame.
        batch: sequences in a batch.
        own: probability, decided per sequence, of crops at the network's own predictions.
        iterations: batches. Where the curriculum moves on when the loss plateaus, the most it
            takes: what it leaves is for the phases after it.
    """

    unroll: int
    batch: int
    own: float
    iterations: int

    def __post_init__(self) -> None:
        if min(self.unroll, self.batch) < 1 or self.iterations < 0 or not 0 <= self.own <= 1:
            raise ValueError(
                f"phase {self} is not usable; expected unroll and batch of 1 or more, iterations "
                "of 0 or more, and a probability `own` in 0..1"
            )


@dataclass(frozen=True)
class PlateauRule:
    """When a loss has stopped falling; see `re3.training.plateau`.

    Attributes:
        window: iterations whose mean loss is compared with that of others.
        improvement: a window is better if its mean is below the best one by this share of it.
        patience: windows in a row without being better, after which it is a plateau.
    """

    window: int = 200
    improvement: float = 0.01
    patience: int = 3

    def __post_init__(self) -> None:
        if self.window < 1 or self.patience < 1 or not 0 <= self.improvement < 1:
            raise ValueError(
                f"{self} is not usable; expected window and patience of 1 or more, and an "
                "improvement from 0 to below 1"
            )


@dataclass(frozen=True)
class CropNoise:
    """Disturbance of the crops. Scales of Laplace distributions, in units of the box's size.

    Attributes:
        drift: shift of the box that both crops are cut at, when it is the truth. Boxes that have
            crept to a part of the object are off by that much, and have to be put right from the
            first template: with half of this drift, tracks kept shrinking (docs/experiments.md).
        drift_scale: likewise, of the log of its width and height.
        drift_limit, drift_scale_limit: largest of each.
        held, held_own: of the log of width and height, an error that stays the same for a whole
            track, with crops at the truth and at own predictions: on top of what differs from step
            to step, or of each prediction. Meant against errors of size that a network makes grow
            by itself (docs/experiments.md).
        jump: extra shift of the current crop alone, as if the camera had moved.
        jump_scale: likewise, of the log of its width and height.
        jump_limit: largest extra shift; at 3x context the object is then just inside the crop.
        jumps, jumps_own: probability of a jump per step, with crops at the truth and at own
            predictions.
        blind: probability per step at the truth of a crop that misses the object altogether, from
            which the score learns what failure looks like.
        stay_lost: probability per sequence that a track on its own predictions is not put back on
            the truth once it has lost the object: what comes after a loss is learnt from as well.
    """

    drift: float = 0.11
    drift_scale: float = 0.2
    drift_limit: float = 0.5
    drift_scale_limit: float = 0.9
    held: float = 0.0
    held_own: float = 0.0
    jump: float = 0.18
    jump_scale: float = 0.05
    jump_limit: float = 1.0
    jumps: float = 0.4
    jumps_own: float = 0.08
    blind: float = 0.03
    stay_lost: float = 0.0


@dataclass(frozen=True)
class LossWeights:
    """Weights of the loss terms; `corners` is the paper's L1, the others help it along.

    Attributes:
        corners: L1 on the corners in regression units.
        overlap: 1 - generalised IoU of the box.
        heat: cross-entropy of the corner heat maps against the cells about the true corner.
        score: binary cross-entropy of the score against the overlap reached.
        outline: binary cross-entropy, of each cell, of which cells show the object, where that is
            known: in simulated clips.
        hidden: factor on the terms of the box while the object is all but hidden.
    """

    corners: float = 1.0
    overlap: float = 0.5
    heat: float = 0.1
    score: float = 0.2
    outline: float = 0.0
    hidden: float = 0.3


@dataclass(frozen=True)
class Recipe:
    """Everything that decides a training run but data and network.

    Attributes:
        phases: the curriculum, in order.
        plateau: when a phase gives way to the next before its iterations are up; None for a fixed
            schedule, each phase exactly as long as it says.
        learning_rate, final_learning_rate: from the first to the second; see `rate_at`.
        drop_at: iteration at which the rate drops to the final one at once, as in the paper; None
            for a cosine over the whole run.
        warm_up: iterations over which the rate rises from nothing.
        weight_decay: of AdamW; without any it is Adam.
        gradient_norm: gradients are clipped to this norm; None does not clip.
        average: decay per iteration of the weight average that is validated and exported; 0 takes
            the weights as they are.
        seed: of weights, data and noise.
        passes: times each roll-out is learnt from. Roll-outs cost more than gradients where the
            trunk is frozen; a few passes give more steps of the optimiser in the same time.
        parts: steps of the optimiser in a pass, each on its share of the sequences.
        learn_trunk: the pretrained trunk is updated as well; otherwise it is frozen.
        trunk_stages: how many of the last stages of an otherwise frozen trunk learn.
        trunk_rate: share of the learning rate at which the trunk learns, 0 to 1.
        trunk_depthwise: the depthwise convolutions of a trunk that learns do so as well. On a CPU
            the gradients of these few weights take as long as those of many others.
        learns: parts of the head that learn, such as ("score",); all of them where none is named.
    """

    phases: tuple[Phase, ...]
    plateau: PlateauRule | None = None
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-5
    drop_at: int | None = None
    warm_up: int = 100
    weight_decay: float = 1e-4
    gradient_norm: float | None = 2.0
    average: float = 0.998
    seed: int = 0
    passes: int = 1
    parts: int = 1
    learn_trunk: bool = False
    trunk_stages: int = 0
    trunk_rate: float = 1.0
    trunk_depthwise: bool = True
    learns: tuple[str, ...] = ()
    noise: CropNoise = CropNoise()
    loss: LossWeights = LossWeights()

    def __post_init__(self) -> None:
        if self.passes < 1:
            raise ValueError(f"passes is {self.passes}; expected 1 or more")
        if not 0 < self.final_learning_rate <= self.learning_rate:
            raise ValueError(
                f"learning rates {self.learning_rate} to {self.final_learning_rate}; expected the "
                "final one above 0 and not above the first"
            )
        if not 0 <= self.average < 1 or self.seed < 0:
            raise ValueError(
                f"average is {self.average} and seed {self.seed}; expected an average from 0 to "
                "below 1 and a seed of 0 or more"
            )
        if self.trunk_stages < 0 or not 0 < self.trunk_rate <= 1:
            raise ValueError(
                f"trunk_stages is {self.trunk_stages} and trunk_rate {self.trunk_rate}; expected "
                "0 stages or more and a share above 0 and up to 1"
            )
        if self.learn_trunk and self.trunk_stages:
            raise ValueError(
                f"learn_trunk, and trunk_stages {self.trunk_stages}: expected one of them, all of "
                "the trunk or its last stages"
            )
        for phase in self.phases:
            if self.parts < 1 or phase.batch % self.parts:
                raise ValueError(
                    f"a batch of {phase.batch} sequences does not split into {self.parts} equal "
                    "parts; choose a number of parts that divides every batch"
                )

    @property
    def iterations(self) -> int:
        return sum(phase.iterations for phase in self.phases)

    def phase_at(self, iteration: int) -> tuple[int, Phase]:
        """Index and phase of an iteration by the fixed schedule; IndexError past the end."""
        for index, phase in enumerate(self.phases):
            if iteration < phase.iterations:
                return index, phase
            iteration -= phase.iterations
        raise IndexError(f"the recipe ends after {self.iterations} iterations")

    def rate_at(self, iteration: int) -> float:
        """The learning rate of an iteration."""
        if self.drop_at is None:
            share = iteration / max(1, self.iterations)
            span = self.learning_rate - self.final_learning_rate
            rate = self.final_learning_rate + span * 0.5 * (1 + math.cos(math.pi * share))
        else:
            rate = self.learning_rate if iteration < self.drop_at else self.final_learning_rate
        return rate * min(1.0, (iteration + 1) / max(1, self.warm_up))

    def scaled(self, factor: float) -> Recipe:
        """The same curriculum with so many times the iterations."""
        phases = (replace(p, iterations=round(p.iterations * factor)) for p in self.phases)
        drop_at = None if self.drop_at is None else round(self.drop_at * factor)
        return replace(self, phases=tuple(phases), drop_at=drop_at)


PAPER = Recipe(
    phases=(
        Phase(unroll=2, batch=64, own=0.0, iterations=40_000),
        Phase(unroll=4, batch=32, own=0.25, iterations=40_000),
        Phase(unroll=8, batch=16, own=0.5, iterations=40_000),
        Phase(unroll=16, batch=8, own=0.75, iterations=40_000),
        Phase(unroll=32, batch=4, own=0.75, iterations=40_000),
    ),
    plateau=PlateauRule(window=500),
    learning_rate=1e-5,
    final_learning_rate=1e-6,
    drop_at=10_000,
    warm_up=0,
    weight_decay=0.0,
    gradient_norm=None,
    average=0.0,
    learn_trunk=True,
    noise=CropNoise(
        drift=0.0, drift_scale=0.0, jump=1 / 5, jump_scale=1 / 15, jumps=1.0, jumps_own=0.0, blind=0
    ),
    loss=LossWeights(corners=1.0, overlap=0.0, heat=0.0, score=0.0, hidden=1.0),
)
"""The paper's (sec. III-B and III-C): L1 on the corners alone; Adam at 1e-5, from iteration 10,000
on at 1e-6, to about 200,000; unrolls double and batches halve when the loss plateaus; all layers
learn and nothing is clipped. The paper does not say what a plateau is, nor how long a phase lasts
at most: both are ours. The Laplace noise is that of the authors' published code
(github.com/danielgordon10/re3-tensorflow, training/tf_dataset.py), here on every crop at the truth.
The score is not learnt: the paper has none. Gradients of all layers for 192 crops at once take the
memory of a GPU."""

FROZEN_TRUNK = Recipe(
    # The paper's curriculum: unrolls double and batches halve, own predictions at 0 to .75.
    phases=(
        Phase(unroll=2, batch=64, own=0.0, iterations=700),
        Phase(unroll=4, batch=32, own=0.25, iterations=400),
        Phase(unroll=8, batch=16, own=0.5, iterations=350),
        Phase(unroll=16, batch=8, own=0.75, iterations=300),
        Phase(unroll=32, batch=4, own=0.75, iterations=300),
    ),
)
"""For a head on a frozen trunk, two hours or so on two cores: a hundred times the paper's rate,
falling along a cosine, losses of box and heat maps beside L1, and an average of the weights."""

RECIPES = {"frozen-trunk": FROZEN_TRUNK, "paper": PAPER}
"""The recipes by name."""
