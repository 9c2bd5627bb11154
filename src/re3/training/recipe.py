"""Training recipes: the curriculum and the optimiser's settings, as values."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Phase:
    """A stretch of training at one unroll length (Re3, sec. III-B).

    Attributes:
        unroll: steps after the initialisation frame.
        batch: sequences in a batch.
        own: probability, decided per sequence, of crops at the network's own predictions.
        iterations: batches.
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
class CropNoise:
    """Disturbance of the crops. Scales of Laplace distributions, in units of the box's size.

    Attributes:
        drift: shift of the box that both crops are cut at, when it is the truth. Boxes that have
            crept to a part of the object are off by that much, and have to be put right from the
            first template: with half of this drift, tracks kept shrinking (docs/experiments.md).
        drift_scale: likewise, of the log of its width and height.
        drift_limit, drift_scale_limit: largest of each.
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
        hidden: factor on the terms of the box while the object is all but hidden.
    """

    corners: float = 1.0
    overlap: float = 0.5
    heat: float = 0.1
    score: float = 0.2
    hidden: float = 0.3


@dataclass(frozen=True)
class Recipe:
    """Everything that decides a training run but data and network.

    Attributes:
        phases: the curriculum, in order.
        learning_rate, final_learning_rate: cosine from the first to the second over all phases.
        warm_up: iterations over which the rate rises from nothing.
        weight_decay: of AdamW.
        gradient_norm: gradients are clipped to this norm.
        average: decay per iteration of the weight average that is validated and exported.
        seed: of weights, data and noise.
        passes: times each roll-out is learnt from. Roll-outs cost more than gradients where the
            trunk is frozen; a few passes give more steps of the optimiser in the same time.
        parts: steps of the optimiser in a pass, each on its share of the sequences.
    """

    phases: tuple[Phase, ...]
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-5
    warm_up: int = 100
    weight_decay: float = 1e-4
    gradient_norm: float = 2.0
    average: float = 0.998
    seed: int = 0
    passes: int = 1
    parts: int = 1
    noise: CropNoise = CropNoise()
    loss: LossWeights = LossWeights()

    def __post_init__(self) -> None:
        if self.passes < 1:
            raise ValueError(f"passes is {self.passes}; expected 1 or more")
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
        """Index and phase of an iteration; raises IndexError past the end."""
        for index, phase in enumerate(self.phases):
            if iteration < phase.iterations:
                return index, phase
            iteration -= phase.iterations
        raise IndexError(f"the recipe ends after {self.iterations} iterations")

    def scaled(self, factor: float) -> Recipe:
        """The same curriculum with so many times the iterations."""
        phases = (replace(p, iterations=round(p.iterations * factor)) for p in self.phases)
        return replace(self, phases=tuple(phases))


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
"""For a head on a frozen trunk, two hours or so on two cores."""
