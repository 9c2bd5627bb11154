"""The batches of a run, drawn from the recipe's seed, the iteration and the place in the batch.

So a resumed run sees what an uninterrupted one would have seen, and processes that share batches
see together what one would.
"""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.data.clip import Clip
from re3.data.sampling import ClipSampler
from re3.training.distributed import Processes
from re3.training.draws import SequenceDraws
from re3.training.recipe import Phase, Recipe


@dataclass(frozen=True, eq=False)
class Batch:
    """This process's share of a batch.

    Attributes:
        clips: N clips of the initialisation frame and the phase's unroll.
        own: `[N]`, True where crops are to be cut at own predictions.
        draws: the noise of the N sequences.
        rng: for what concerns the batch as a whole; the same in every process.
    """

    clips: list[Clip]
    own: NDArray[np.bool_]
    draws: SequenceDraws
    rng: np.random.Generator


class Batches:
    """Draws batches, the next one while this one is learnt from.

    Args:
        sampler: of the clips.
        recipe: of its seed.
        processes: that share every batch.
        pool: draws clips in parallel.
    """

    def __init__(
        self, sampler: ClipSampler, recipe: Recipe, processes: Processes, pool: Executor
    ) -> None:
        self.sampler, self.recipe, self.processes, self.pool = sampler, recipe, processes, pool
        self._ahead: tuple[int, Phase, list[Future[Clip]]] | None = None

    def prepare(self, iteration: int, phase: Phase) -> None:
        """Begin to draw the clips of an iteration, if it comes to be of this phase."""
        self._ahead = iteration, phase, self._begin(iteration, phase)

    def get(self, iteration: int, phase: Phase) -> Batch:
        """The batch of an iteration; waits for its clips."""
        ahead, self._ahead = self._ahead, None
        if ahead is not None and ahead[:2] == (iteration, phase):
            futures = ahead[2]
        else:
            for future in ahead[2] if ahead is not None else ():
                future.cancel()
            futures = self._begin(iteration, phase)
        seeds, share = self._seeds(iteration, phase)
        rng, own = _own(seeds[0], phase)
        draws = SequenceDraws([np.random.default_rng(s.spawn(2)[1]) for s in seeds[1:][share]])
        clips = [future.result() for future in futures]
        return Batch(clips, own[share], draws, rng)

    def _begin(self, iteration: int, phase: Phase) -> list[Future[Clip]]:
        seeds, share = self._seeds(iteration, phase)
        rngs = [np.random.default_rng(seed.spawn(2)[0]) for seed in seeds[1:][share]]
        return [self.pool.submit(self.sampler.sample, phase.unroll + 1, rng) for rng in rngs]

    def _seeds(self, iteration: int, phase: Phase) -> tuple[list[np.random.SeedSequence], slice]:
        """Seeds of the whole batch and of each sequence, and which are this process's."""
        seeds = np.random.SeedSequence([self.recipe.seed, iteration]).spawn(phase.batch + 1)
        return seeds, self.processes.share(phase.batch)


def _own(
    seed: np.random.SeedSequence, phase: Phase
) -> tuple[np.random.Generator, NDArray[np.bool_]]:
    """The generator of a batch as a whole, and its first draw: which tracks go on by themselves."""
    rng = np.random.default_rng(seed)
    return rng, rng.random(phase.batch) < phase.own
