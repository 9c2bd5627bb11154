"""How the variants of the ablation study are trained (Re3, Table I)."""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import replace

from re3.data.sampling import ClipSampler
from re3.data.sampling_config import PAPER_SAMPLING, SamplingConfig
from re3.data.sequence import Sequence
from re3.network.table_one import Variant
from re3.training.recipe import FROZEN_TRUNK, PAPER, Phase, Recipe

SAMPLING = {"paper": PAPER_SAMPLING, "lite": SamplingConfig(leaps=0.0)}
"""Name of the scale -> how clips are drawn. The paper's have no temporal gaps."""

RECIPES = {
    "paper": replace(PAPER, plateau=None),
    "lite": replace(
        FROZEN_TRUNK,
        # About 100 pairs of crops an iteration: twenty minutes of one core are some 600 of them.
        phases=(
            Phase(unroll=2, batch=32, own=0.0, iterations=300),
            Phase(unroll=4, batch=20, own=0.25, iterations=200),
            Phase(unroll=8, batch=12, own=0.5, iterations=180),
            Phase(unroll=16, batch=8, own=0.75, iterations=150),
            Phase(unroll=32, batch=4, own=0.75, iterations=120),
        ),
        # A roll-out costs six times what is learnt from it in one pass.
        passes=3,
        warm_up=50,
        noise=PAPER.noise,
    ),
}
"""Name of the scale -> recipe. Both have the paper's noise on the crops; phases have fixed lengths,
so that all variants take the same course."""


def variant_recipe(variant: Variant, recipe: Recipe) -> Recipe:
    """The recipe as a variant is trained by it: without own predictions, crops are at the truth."""
    if variant.own_predictions:
        return recipe
    return replace(recipe, phases=tuple(replace(phase, own=0.0) for phase in recipe.phases))


def shortened(recipe: Recipe, iterations: int) -> Recipe:
    """The same course over exactly so many iterations."""
    whole, done, ends = recipe.iterations, 0, [0]
    for phase in recipe.phases:
        done += phase.iterations
        ends.append(round(done * iterations / whole))
    phases = tuple(
        replace(phase, iterations=end - start)
        for phase, start, end in zip(recipe.phases, ends[:-1], ends[1:], strict=True)
    )
    scaled = recipe.scaled(iterations / whole)  # the drop of the learning rate goes along
    return replace(scaled, phases=phases)


def video_sources(sequences: Several[Sequence]) -> dict[str, int]:
    """Name of every dataset of videos -> annotated boxes in it, the largest first."""
    boxes: dict[str, int] = {}
    for sequence in sequences:
        count = int(sequence.annotated.sum())
        boxes[sequence.dataset] = boxes.get(sequence.dataset, 0) + count
    return dict(sorted(boxes.items(), key=lambda item: (-item[1], item[0])))


def chosen_sources(
    sequences: Several[Sequence], large: str | None, other: str | None
) -> tuple[str, str]:
    """The datasets of videos that some variants do without.

    Args:
        sequences: of all datasets.
        large, other: names, several of them with commas between; None for the one with most boxes,
            and with most but for those.

    Returns:
        both, the second empty where no dataset is left for it.

    Raises:
        ValueError: no videos, no dataset of that name, or twice the same.
    """
    sources = list(video_sources(sequences))
    if not sources:
        raise ValueError("no videos with boxes to train on; expected --data with some")
    for name in (*_names(large), *_names(other)):
        if name not in sources:
            raise ValueError(f"no dataset of videos {name!r}; there are {', '.join(sources)}")
    if large is None:
        large = next((name for name in sources if name not in _names(other)), sources[0])
    if other is None:
        other = next((name for name in sources if name not in _names(large)), "")
    if twice := sorted(set(_names(large)) & set(_names(other))):
        raise ValueError(
            f"{twice[0]!r} is given as both sources; expected other datasets of videos for each"
        )
    return large, other


def _names(source: str | None) -> list[str]:
    return [name.strip() for name in (source or "").split(",") if name.strip()]


def variant_sampler(
    variant: Variant, data: ClipSampler, large: str, other: str, scale: str
) -> ClipSampler:
    """What a variant is trained on.

    Args:
        variant: of Table I.
        scale: `lite` or `paper`.
        data: everything there is.
        large, other: as `chosen_sources` gives them.

    Raises:
        ValueError: nothing is left of what it is to be trained on.
    """
    if not other and not variant.other_source:
        raise ValueError(
            f"variant {variant.letter} ({variant.about}) needs two datasets of videos in --data, "
            f"there is only {large}; leave it out with --variants"
        )
    without = {
        name
        for source, used in ((large, variant.large_source), (other, variant.other_source))
        if not used
        for name in _names(source)
    }
    sequences = [s for s in data.sequences if s.dataset not in without]
    stills = data.stills if variant.simulated else []
    if not sequences or (variant.simulated and not stills):
        missing = "stills" if sequences else f"videos besides {', '.join(sorted(without))}"
        raise ValueError(
            f"variant {variant.letter} ({variant.about}) needs {missing}; give --data with some, "
            "or leave it out with --variants"
        )
    return ClipSampler(sequences, stills, data.store, SAMPLING[scale])
