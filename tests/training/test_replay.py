"""Replay: long tracks are walked, and stretches drawn of them by what went wrong."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny import SMALL as TINY

from re3.network.re3_lite import Re3Lite
from re3.training.batches import Batches
from re3.training.distributed import ALONE
from re3.training.features import FrozenTrunk
from re3.training.recipe import CropNoise, Phase, Recipe
from re3.training.replay import draw_starts, walk_batch
from re3.training.rollout import join, roll_out
from re3.training.throughput import Stopwatch
from re3.training.trainer import Trainer

QUIET = CropNoise(drift=0, drift_scale=0, jump=0, jump_scale=0, jumps=0, jumps_own=0, blind=0)
PHASE = Phase(2, 4, 0.5, 2)
RECIPE = Recipe(phases=(PHASE,), replay=5, noise=QUIET, warm_up=1, average=0.5, seed=1)


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return Re3Lite(TINY).eval()


@pytest.fixture(scope="module")
def trunk(network):
    return FrozenTrunk(network, 2)


def walked(sampler, network, trunk, recipe):
    with ThreadPoolExecutor(2) as pool:
        batch = Batches(sampler, recipe, ALONE, pool).get(0, PHASE)
        return batch, walk_batch(batch, network, trunk, recipe, pool, Stopwatch())


def roll(sampler, network, trunk, seeds, steps=6):
    clips = [sampler.sample(steps, np.random.default_rng(seed)) for seed in seeds]
    own = np.ones(len(clips), dtype=bool)
    with ThreadPoolExecutor(2) as pool:
        rng = np.random.default_rng(0)
        return clips, roll_out(clips, own, network, trunk, QUIET, rng, pool)


def test_stretches_are_drawn_where_boxes_got_worse():
    overlap = np.full((33, 1), 0.8)
    overlap[0], overlap[20:] = np.nan, 0.05  # lost at step 20
    drawn = np.linspace(0.001, 0.999, 999)
    starts = draw_starts(np.repeat(overlap, 999, axis=1), 8, drawn)
    assert starts.min() >= 1
    assert starts.max() + 8 <= 33
    with_the_loss = (starts <= 20) & (starts + 8 > 20)
    assert with_the_loss.mean() > 0.75  # 8 of 25 stretches
    assert (starts > 20).mean() < (starts < 13).mean()  # what is lost already says little


def test_stretches_of_a_track_that_holds_are_drawn_alike():
    drawn = np.linspace(0.001, 0.999, 2000)
    starts = draw_starts(np.full((11, 2000), np.nan), 3, drawn)
    counts = np.bincount(starts)
    assert counts[0] == 0
    assert len(counts) == 9
    np.testing.assert_allclose(counts[1:], 250, atol=3)


def test_a_stretch_is_learnt_from_as_if_it_came_after_a_leap(sampler, network, trunk):
    _, rollout = roll(sampler, network, trunk, range(3))
    starts = np.array([1, 2, 4])
    window = rollout.window(starts, 3)
    assert window.steps == 3
    taken = np.array([(0, start, start + 1) for start in starts]).T
    for name in ("targets", "has_box", "hidden", "images"):
        whole, part = (np.asarray(getattr(r, name)) for r in (rollout, window))
        expected = whole.reshape(6, 3, -1)[taken, np.arange(3)]
        np.testing.assert_array_equal(part.reshape(3, 3, -1), expected)
    looked = window.looked.reshape(3, 3, 4)
    # What is known of the first frame is about the box given there, a third of the crop.
    third = torch.tensor([10 / 3, 10 / 3, 20 / 3, 20 / 3])
    torch.testing.assert_close(looked[1], third.expand(3, 4), atol=1e-3, rtol=0)
    torch.testing.assert_close(looked[2], rollout.looked.reshape(6, 3, 4)[starts + 1, range(3)])


def test_a_stretch_from_the_first_step_on_is_the_begin_of_the_roll_out(sampler, network, trunk):
    _, rollout = roll(sampler, network, trunk, range(2))
    window = rollout.window(np.ones(2, dtype=np.int64), 4)
    torch.testing.assert_close(window.targets, rollout.targets[: 4 * 2])
    torch.testing.assert_close(window.crops, tuple(one[: 4 * 2] for one in rollout.crops))
    np.testing.assert_array_equal(window.overlap, rollout.overlap[:4])


def test_overlaps_are_those_of_own_predictions(sampler, network, trunk):
    _, rollout = roll(sampler, network, trunk, range(2))
    assert rollout.overlap.shape == (6, 2)
    assert np.isnan(rollout.overlap[[0, 5]]).all()
    assert ((rollout.overlap[1:5] >= 0) & (rollout.overlap[1:5] <= 1)).all()


def test_joined_roll_outs_hold_the_sequences_of_each(sampler, network, trunk):
    _, first = roll(sampler, network, trunk, range(2))
    _, second = roll(sampler, network, trunk, [2])
    both = join([first, second])
    for part, which in ((first, [0, 1]), (second, [2])):
        piece = both.part(np.array(which))
        torch.testing.assert_close(piece.targets, part.targets)
        torch.testing.assert_close(piece.crops, part.crops)
        np.testing.assert_array_equal(piece.images, part.images)
        np.testing.assert_array_equal(piece.overlap, part.overlap)
        torch.testing.assert_close(piece.begun, part.begun)


def test_only_tracks_on_own_predictions_are_walked_for_longer(sampler, network, trunk):
    batch, rollout = walked(sampler, network, trunk, RECIPE)
    assert 0 < batch.own.sum() < 4
    lengths = [len(clip.boxes_xyxy) for clip in batch.clips]
    assert lengths == [6 if own else 3 for own in batch.own]
    assert rollout.steps == 3
    assert len(rollout.targets) == 3 * 4


@pytest.mark.parametrize("own", [0.0, 1.0])
def test_all_tracks_may_be_of_one_kind(sampler, network, trunk, own):
    recipe = replace(RECIPE, phases=(replace(PHASE, own=own),))
    with ThreadPoolExecutor(2) as pool:
        batch = Batches(sampler, recipe, ALONE, pool).get(0, recipe.phases[0])
        rollout = walk_batch(batch, network, trunk, recipe, pool, Stopwatch())
    assert len(rollout.targets) == 3 * 4


def test_without_replay_a_batch_is_walked_as_it_is(sampler, network, trunk):
    _, rollout = walked(sampler, network, trunk, replace(RECIPE, replay=0))
    with ThreadPoolExecutor(2) as pool:
        again = Batches(sampler, RECIPE, ALONE, pool).get(0, PHASE)
        clips = [
            sampler.sample(3, np.random.default_rng(s.spawn(2)[0]))
            for s in np.random.SeedSequence([RECIPE.seed, 0]).spawn(5)[1:]
        ]
        expected = roll_out(clips, again.own, network, trunk, QUIET, again.draws, pool)
    torch.testing.assert_close(rollout.targets, expected.targets)


def test_training_replays(sampler, tmp_path):
    torch.manual_seed(0)
    network = Re3Lite(TINY)
    before = network.head.heat.weight.clone()
    Trainer(network, sampler, RECIPE, tmp_path, threads=1).train()
    assert not torch.equal(network.head.heat.weight, before)


def test_fewer_steps_than_the_unroll_are_refused():
    with pytest.raises(ValueError, match="replay is 1; expected 0, or no fewer steps than the lon"):
        replace(RECIPE, replay=1)
