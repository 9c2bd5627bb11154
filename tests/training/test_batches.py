from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from re3.training.batches import Batches
from re3.training.distributed import ALONE, Processes
from re3.training.recipe import Phase, Recipe

PHASE, NEXT_PHASE = Phase(2, 4, 0.5, 10), Phase(4, 2, 0.5, 10)


@pytest.fixture
def batches(sampler):
    with ThreadPoolExecutor(2) as pool:
        recipe = Recipe(phases=(PHASE, NEXT_PHASE))
        yield lambda processes=ALONE, seed=0: Batches(
            sampler, replace(recipe, seed=seed), processes, pool
        )


def content(batch):
    """All that a batch holds and draws, a row a sequence."""
    n = len(batch.clips)
    boxes = np.stack([clip.boxes_xyxy for clip in batch.clips]).reshape(n, -1)
    pixels = np.stack([np.asarray(clip.frames, np.float64).mean() for clip in batch.clips])
    noise = batch.draws.laplace(0.0, 1.0, (n, 2))
    return np.concatenate([boxes, pixels[:, None], batch.own[:, None], noise], axis=1)


def test_a_batch_follows_from_seed_and_iteration(batches):
    first = content(batches().get(3, PHASE))
    np.testing.assert_array_equal(content(batches().get(3, PHASE)), first)
    assert not np.array_equal(content(batches().get(4, PHASE)), first)
    assert not np.array_equal(content(batches(seed=1).get(3, PHASE)), first)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_shares_of_processes_are_the_whole(batches, count):
    shares = [content(batches(Processes(rank, count)).get(3, PHASE)) for rank in range(count)]
    np.testing.assert_array_equal(np.concatenate(shares), content(batches().get(3, PHASE)))


@pytest.mark.parametrize(
    ("iteration", "phase"),
    [
        (4, PHASE),  # as foreseen
        (4, NEXT_PHASE),  # the loss has plateaued meanwhile
        (7, PHASE),  # another iteration
    ],
)
def test_what_was_prepared_changes_nothing(batches, iteration, phase):
    ahead = batches()
    ahead.prepare(4, PHASE)
    got = content(ahead.get(iteration, phase))
    np.testing.assert_array_equal(got, content(batches().get(iteration, phase)))


def test_prepared_clips_are_used(batches, sampler, monkeypatch):
    ahead, drawn = batches(), []
    sample = sampler.sample
    monkeypatch.setattr(sampler, "sample", lambda *a: drawn.append(a) or sample(*a))
    ahead.prepare(4, PHASE)
    ahead.get(4, PHASE)
    assert len(drawn) == PHASE.batch
