"""Replay of hard examples: long tracks are walked, and what went wrong in them is learnt from.

A track of a few steps from a true box hardly ever shows the moment at which a tracker loses its
object. So tracks on own predictions are walked for longer than they are unrolled, without
gradients, and a stretch is drawn of each, the sooner the more its boxes got worse in it. The
recurrent state begins anew before the stretch, as it does in tracking every so many frames. Of the
kind of hard-example mining (Shrivastava et al., 2016), over time rather than over regions.
"""

from __future__ import annotations

from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from re3.geometry import Floats
from re3.network.base import TrackingNetwork
from re3.training.batches import Batch
from re3.training.features import Trunk
from re3.training.recipe import Recipe
from re3.training.rollout import Rollout, join, roll_out
from re3.training.throughput import Stopwatch

SHARPNESS = 3.0
"""Power of a stretch's blame to which its probability is proportional."""

LEAST_BLAME = 0.02
"""Blame of a step that went well, so that a track without a loss can be drawn from as well."""


def walk_batch(
    batch: Batch,
    network: TrackingNetwork,
    trunk: Trunk,
    recipe: Recipe,
    pool: Executor,
    watch: Stopwatch,
) -> Rollout:
    """The roll-out of a batch, `batch.unroll` steps after the first of each sequence.

    With replay, the sequences on own predictions come first, a stretch of each; then the others.

    Args:
        batch: its clips on own predictions are of `recipe.replay` steps, if that is set.
        network, trunk: see `roll_out`.
        recipe: of noise and replay.
        pool: cuts crops in parallel.
        watch: gets the time of the parts.
    """

    def walk(which: NDArray[np.int64]) -> Rollout:
        clips = [batch.clips[index] for index in which]
        draws, own = batch.draws.part(which), batch.own[which]
        outlined = recipe.loss.outline > 0
        return roll_out(clips, own, network, trunk, recipe.noise, draws, pool, watch, outlined)

    if not recipe.replay:
        return walk(np.arange(len(batch.clips)))
    parts = []
    own = np.flatnonzero(batch.own)
    if len(own):
        long = walk(own)
        starts = draw_starts(long.overlap, batch.unroll, batch.draws.part(own).random(len(own)))
        parts.append(long.window(starts, batch.unroll + 1))
    others = np.flatnonzero(~batch.own)
    if len(others):
        parts.append(walk(others))
    return join(parts)


def draw_starts(overlap: Floats, length: int, drawn: Floats) -> NDArray[np.int64]:
    """First steps `[N]` of the stretches to learn from.

    A step is to blame for the overlap that it lost of what it began with: the product of the
    overlap before and the square of what is missing after. A box that has gone already says little.

    Args:
        overlap: `[steps, N]`, NaN where unknown; see `Rollout`.
        length: steps of a stretch.
        drawn: `[N]` numbers in 0..1, by which the starts are picked.
    """
    before, after = np.nan_to_num(overlap[:-1], nan=0.0), np.nan_to_num(overlap[1:], nan=1.0)
    before[0] = 1.0  # the first frame's box is given
    blame = LEAST_BLAME + before * (1.0 - after) ** 2  # of steps 1 to the last
    sums = np.cumsum(np.concatenate([np.zeros((1, blame.shape[1])), blame]), axis=0)
    weights = (sums[length:] - sums[:-length]) ** SHARPNESS  # of stretches from step 1 on
    reached = np.cumsum(weights, axis=0) / weights.sum(axis=0)
    starts: NDArray[np.int64] = 1 + (reached < drawn).sum(axis=0)
    return np.minimum(starts, len(weights))
