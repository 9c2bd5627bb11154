"""Roll-outs and the training loop on a tiny network and drawn clips."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from tiny import SMALL as TINY

from re3.data.augment import AugmentedClip
from re3.data.clip import MirroredClip, Origin, RecordedClip
from re3.geometry import decode, encode, search_region
from re3.network.base import Seen
from re3.network.re3_lite import Re3Lite
from re3.training.device import Device
from re3.training.features import FrozenTrunk
from re3.training.recipe import CropNoise, LossWeights, Phase, Recipe
from re3.training.records import LOG, read_log
from re3.training.rollout import roll_out
from re3.training.trainer import Trainer, TrainingError

QUIET = CropNoise(drift=0, drift_scale=0, jump=0, jump_scale=0, jumps=0, jumps_own=0, blind=0)
RECIPE = Recipe(
    phases=(Phase(2, 2, 0.0, 2), Phase(3, 2, 1.0, 2)), warm_up=1, average=0.5, learning_rate=3e-3
)


def tiny_network():
    torch.manual_seed(0)
    return Re3Lite(TINY).eval()


@pytest.fixture(scope="module")
def trunk():
    return FrozenTrunk(tiny_network(), 2)


def roll(sampler, own, trunk, network=None, noise=QUIET, steps=4):
    clips = [sampler.sample(steps, np.random.default_rng(s)) for s in range(len(own))]
    network = network or tiny_network()
    with ThreadPoolExecutor(2) as pool:
        rng = np.random.default_rng(0)
        return clips, roll_out(clips, np.array(own), network, trunk, noise, rng, pool)


def test_the_frozen_trunk_equals_torch(trunk):
    network = tiny_network()
    crops = np.random.default_rng(0).integers(0, 256, (11, 96, 96, 3), dtype=np.uint8)
    with torch.no_grad():
        expected = network.features(torch.from_numpy(crops))
    for got, wanted in zip(trunk(crops), expected, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-4)


def test_crops_at_the_truth_have_the_motion_as_target(sampler, trunk):
    clips, rollout = roll(sampler, [False, False], trunk)
    targets = rollout.targets.reshape(4, 2, 4).numpy()
    for n, clip in enumerate(clips):
        for t in range(4):
            region = search_region(clip.boxes_xyxy[max(t - 1, 0)], TINY.current.context)
            found = decode(targets[t, n], region)
            np.testing.assert_allclose(found, clip.boxes_xyxy[t], atol=1e-3)


def test_after_a_leap_the_crop_is_cut_at_the_truth(trunk):
    image = np.random.default_rng(0).integers(0, 256, (80, 200, 3), dtype=np.uint8)
    boxes = np.array([(10, 10, 34, 30), (150, 40, 174, 60), (152, 40, 176, 60)], float)
    clip = RecordedClip([image] * 3, boxes, (127.0,) * 3, leaps=True)
    with ThreadPoolExecutor(1) as pool:
        rollout = roll_out(
            [clip],
            np.array([False]),
            tiny_network(),
            trunk,
            QUIET,
            np.random.default_rng(0),
            pool,
        )
    still = np.array([10 / 3, 10 / 3, 20 / 3, 20 / 3])
    np.testing.assert_allclose(rollout.targets[1], still, atol=1e-5)  # not where it was before
    assert rollout.has_box.all()
    # What is known of the first frame is about the box given there.
    np.testing.assert_allclose(rollout.looked[1], still, atol=1e-5)


class OutlinedClip(RecordedClip):
    """Of an object that fills its box."""

    def outline(self, frame, region_xyxy, cells):
        left, top, right, bottom = encode(self.boxes_xyxy[frame], region_xyxy) * cells / 10
        at = np.arange(cells) + 0.5
        across, down = (left < at) & (at < right), (top < at) & (at < bottom)
        return (down[:, None] & across).astype(np.float32)


def test_outlines_are_of_the_crops_and_only_where_asked_for(sampler, trunk):
    clips = [sampler.sample(4, np.random.default_rng(s)) for s in range(3)]
    clips[1] = OutlinedClip(clips[1].frames, clips[1].boxes_xyxy, clips[1].fill)
    with ThreadPoolExecutor(2) as pool:
        rollout, without = (
            roll_out(
                clips,
                np.zeros(3, bool),
                tiny_network(),
                trunk,
                QUIET,
                np.random.default_rng(0),
                pool,
                outlined=asked,
            )
            for asked in (True, False)
        )
    assert without.outlines is None
    assert rollout.outlines.shape == (4 * 3, TINY.grid, TINY.grid)
    known = ~rollout.outlines.isnan().any(dim=(1, 2)).reshape(4, 3)
    assert (known == torch.tensor([False, True, False])).all()
    assert rollout.part(np.array([0, 2])).outlines.isnan().all()
    for outline, target in zip(rollout.outlines[1::3], rollout.targets[1::3], strict=True):
        rows, columns = np.nonzero(outline.numpy())
        edges = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        np.testing.assert_allclose(edges / TINY.grid * 10, target, atol=0.6)


def test_a_lost_track_may_stay_lost(sampler, trunk):
    network = tiny_network()
    with torch.no_grad():
        network.head.residual.bias.copy_(torch.tensor([9.0, 9.0, 12.0, 12.0]))
    stay = replace(QUIET, stay_lost=1.0)
    _, rollout = roll(sampler, [True, True], trunk, network, noise=stay)
    assert rollout.put_back == 0
    assert not rollout.has_box.reshape(4, 2)[3].any()


def drifting_network():
    """A network that always sees the object a little further right."""
    network = tiny_network()
    with torch.no_grad():
        network.head.residual.bias.copy_(torch.tensor([-1.6667, -1.6667, 1.6667, 1.6667]) + 0.3)
    return network


def roll_where_it_leaves(trunk, own, absent, steps, network, mirrored=False):
    """The roll-out of a clip of one noisy picture, in some frames of which there is no object."""
    image = np.random.default_rng(0).integers(0, 100, (60, 80, 3), dtype=np.uint8)
    boxes = np.tile([30.0, 20.0, 46.0, 36.0], (steps, 1))
    boxes[absent] = np.nan
    clip = RecordedClip([image] * steps, boxes, (255.0,) * 3)
    clip = MirroredClip(clip) if mirrored else clip
    rng = np.random.default_rng(0)
    with ThreadPoolExecutor(1) as pool:
        return roll_out([clip], np.array([own]), network, trunk, QUIET, rng, pool)


@pytest.mark.parametrize("own", [True, False])
def test_own_predictions_go_on_where_the_object_is_absent(trunk, own):
    rollout = roll_where_it_leaves(trunk, own, slice(2, 7), 7, drifting_network())
    assert rollout.has_box.tolist() == [1, 1, 0, 0, 0, 0, 0]
    assert (rollout.targets[2:] == 0).all()
    moved = [not np.array_equal(a, b) for a, b in pairwise(rollout.images[2:])]
    assert moved == [own] * 4  # crops at the truth stay where the object was last
    assert rollout.put_back == 0


@pytest.mark.parametrize("mirrored", [False, True])
def test_own_predictions_stay_within_the_frame(trunk, mirrored):
    network = drifting_network()
    with torch.no_grad():
        network.head.residual.bias.add_(0.5)
    rollout = roll_where_it_leaves(trunk, True, slice(2, 30), 30, network, mirrored)
    outside = (rollout.images == 255).all(axis=3).mean(axis=(1, 2))
    assert outside[0] == 0
    assert outside[-1] > 0.4  # at a corner of the frame
    assert outside.max() < 0.8  # never beyond it


def test_a_track_is_put_back_where_the_object_comes_back_elsewhere(trunk):
    network = drifting_network()
    with torch.no_grad():
        network.head.residual.bias.add_(0.5)
    rollout = roll_where_it_leaves(trunk, True, slice(2, 12), 15, network)
    assert rollout.has_box[12:].tolist() == [0, 1, 1]
    assert rollout.put_back > 0


def test_own_predictions_move_the_crops(sampler, trunk):
    clips, rollout = roll(sampler, [True, False], trunk, drifting_network())
    targets = rollout.targets.reshape(4, 2, 4).numpy()
    for n, moves in ((0, True), (1, False)):
        at_truth = search_region(clips[n].boxes_xyxy[2], TINY.current.context)
        error = np.abs(decode(targets[3, n], at_truth) - clips[n].boxes_xyxy[3]).max()
        assert (error > 0.2) == moves


def test_a_hopeless_prediction_is_put_back_on_the_truth(sampler, trunk):
    network = tiny_network()
    with torch.no_grad():
        network.head.residual.bias.copy_(torch.tensor([90.0, 90.0, 99.0, 99.0]))
    _, rollout = roll(sampler, [True, True], trunk, network)
    assert rollout.has_box.all() or rollout.put_back > 0


def test_a_held_error_of_size_lasts_for_a_track(sampler, trunk):
    noise = replace(QUIET, held=0.2)
    _, rollout = roll(sampler, [False, False, True], trunk, noise=noise)
    targets = rollout.targets.reshape(4, 3, 4).numpy()
    sides = targets[..., 2:] - targets[..., :2]  # of an object that keeps its size
    np.testing.assert_allclose(sides[0], 10 / 3, atol=1e-5)
    np.testing.assert_allclose(sides[1:, :2], np.broadcast_to(sides[1, :2], (3, 2, 2)), atol=1e-5)
    assert (np.abs(sides[1, :2] - 10 / 3) > 0.01).all()
    assert len(np.unique(sides[1, :2].round(4))) == 4  # each of its own, width and height too
    np.testing.assert_allclose(sides[1, 2], 10 / 3, atol=1e-5)  # own predictions have none


def test_own_predictions_are_shown_with_a_held_error_of_their_own(sampler, trunk):
    plain = roll(sampler, [True, False], trunk)[1]
    held = roll(sampler, [True, False], trunk, noise=replace(QUIET, held_own=0.2))[1]
    sides = [
        (part.targets[:, 2:] - part.targets[:, :2]).reshape(4, 2, 2).numpy()
        for part in (plain, held)
    ]
    np.testing.assert_allclose(sides[0][1], 10 / 3, atol=1e-5)
    assert (np.abs(sides[1][1, 0] - 10 / 3) > 0.01).all()
    np.testing.assert_allclose(sides[1][:, 1], sides[0][:, 1], atol=1e-5)


def test_blind_crops_have_no_box(sampler, trunk):
    _, rollout = roll(sampler, [False] * 3, trunk, noise=replace(QUIET, blind=1.0))
    has_box = rollout.has_box.reshape(4, 3)
    assert has_box[0].all()
    assert not has_box[1:].any()


def make(sampler, folder, recipe=RECIPE):
    return Trainer(tiny_network(), sampler, recipe, folder)


def weights(trainer):
    return torch.cat([p.detach().flatten() for p in trainer.network.head.parameters()])


def test_a_resumed_run_equals_an_uninterrupted_one(sampler, tmp_path):
    whole = make(sampler, tmp_path / "whole")
    whole.train()

    class Stop(Exception):
        pass

    def stop(progress):
        if progress.iteration == 3:
            raise Stop

    first = make(sampler, tmp_path / "parts")
    with pytest.raises(Stop):
        first.train(stop, checkpoint_seconds=0)  # killed after a checkpoint at iteration 2
    second = make(sampler, tmp_path / "parts")
    assert second.iteration == 2
    second.train()
    np.testing.assert_allclose(weights(second), weights(whole), atol=1e-6)


def test_a_run_from_before_outlines_were_drawn_goes_on(sampler, tmp_path):
    first = make(sampler, tmp_path)
    first.train()
    path = tmp_path / "checkpoint.pt"
    values = torch.load(path, weights_only=True)
    for which in ("network", "average"):
        values[which] = {k: v for k, v in values[which].items() if "outline" not in k}
    torch.save(values, path)
    second = make(sampler, tmp_path)
    assert second.iteration == first.iteration
    np.testing.assert_array_equal(weights(second), weights(first))


def test_a_roll_out_may_be_learnt_from_in_parts_and_passes(sampler, tmp_path, monkeypatch):
    recipe = replace(RECIPE, phases=(Phase(2, 4, 0.0, 1),), passes=3, parts=2)
    trainer = make(sampler, tmp_path, recipe)
    learnt = []
    monkeypatch.setattr(
        trainer,
        "_learn",
        lambda rollout, learn=trainer._learn: learnt.append(rollout) or learn(rollout),
    )
    trainer.train()
    assert [len(part.targets) for part in learnt] == [3 * 2] * 6  # steps x sequences
    for one in range(0, 6, 2):  # the two parts of a pass hold every sequence once
        rows = torch.cat([part.targets.reshape(3, 2, 4)[1] for part in learnt[one : one + 2]])
        assert len(torch.unique(rows, dim=0)) == 4


def test_a_part_holds_all_steps_of_its_sequences(sampler, trunk):
    _, rollout = roll(sampler, [False] * 3, trunk)
    part = rollout.part(np.array([2, 0]))
    for whole, piece in [
        (rollout.targets, part.targets),
        (rollout.crops[1], part.crops[1]),
        (rollout.looked, part.looked),
    ]:
        expected = whole.reshape(4, 3, *whole.shape[1:])[:, [2, 0]]
        torch.testing.assert_close(piece.reshape(4, 2, *whole.shape[1:]), expected)


class TwoSources:
    """Clips that say which of two sources they are of, the others of none."""

    sequences = stills = ()

    def __init__(self, sampler, names):
        self.sampler, self.names = sampler, iter(names)

    def sample(self, frames, rng):
        clip, name = self.sampler.sample(frames, rng), next(self.names)
        return AugmentedClip(clip, rng, origin=name and Origin(name, "videos", "clip"))


def test_the_loss_is_told_by_source(sampler, tmp_path):
    names = ["uav", "stills", "uav", None]
    recipe = replace(RECIPE, phases=(Phase(2, 4, 0.0, 1),), loss=LossWeights(1.0, 0.0, 0.0, 0.0))
    # One thread draws the clips in order.
    trainer = Trainer(tiny_network(), TwoSources(sampler, names), recipe, tmp_path, 1)
    learnt = []
    learn = trainer._learn
    trainer._learn = lambda rollout: learnt.append(learn(rollout)) or learnt[-1]
    trainer.train()
    (one,) = learnt
    assert one.rollout.sources == ("uav", "stills", "uav", "")
    errors = (one.corners - one.rollout.targets).abs().mean(dim=1).reshape(3, 4)
    present = one.rollout.has_box.reshape(3, 4)
    expected = {}
    for name, columns in (("stills", [1]), ("uav", [0, 2])):
        boxes = present[:, columns]
        expected[name] = float((errors[:, columns] * boxes).sum() / boxes.sum())
    assert one.sources == pytest.approx(expected, abs=1e-5)
    assert expected["stills"] != pytest.approx(expected["uav"], abs=1e-3)
    assert read_log(tmp_path / LOG)[0]["sources"] == pytest.approx(expected, abs=1e-4)
    # A part of the batch has the sources of its sequences.
    assert one.rollout.part(np.array([3, 1])).sources == ("", "stills")


def test_each_phase_tells_where_its_time_went(sampler, tmp_path):
    ended = []
    make(sampler, tmp_path).train(on_phase=ended.append)
    assert [(phase.phase, phase.unroll, phase.iterations) for phase in ended] == [
        (0, 2, 2),
        (1, 3, 2),
    ]
    for phase in ended:
        assert sum(phase.shares.values()) == pytest.approx(1.0)
        assert {"clips", "crops", "features", "learn"} <= phase.shares.keys()
        assert phase.pairs_per_second > 0
    assert "walk" not in ended[0].seconds  # crops at the truth alone
    assert ended[1].seconds["walk"] > 0
    told = [entry for entry in read_log(tmp_path / LOG) if "throughput" in entry]
    assert [(entry["iteration"], entry["throughput"]) for entry in told] == [
        (2, ended[0].figures()),
        (4, ended[1].figures()),
    ]


def test_training_learns(sampler, tmp_path):
    losses = []
    recipe = replace(RECIPE, phases=(Phase(2, 4, 0.0, 30),), warm_up=5)
    make(sampler, tmp_path, recipe).train(lambda p: losses.append(p.loss))
    assert np.mean(losses[-5:]) < 0.9 * np.mean(losses[:5])


def test_the_best_weights_by_validation_are_kept(sampler, tmp_path):
    trainer = make(sampler, tmp_path)
    figures = iter([{"AUC": 0.5}, {"AUC": 0.7}, {"AUC": 0.6}, {"AUC": 0.1}])
    trainer.train(validate=lambda network: next(figures), validation_seconds=-1.0)
    best = torch.load(tmp_path / "best.pt", weights_only=True)
    assert best["figures"] == {"AUC": 0.7}


def test_after_each_phase_there_is_a_validation(sampler, tmp_path):
    validated = []
    trainer = make(sampler, tmp_path)
    trainer.train(validate=lambda network: validated.append(trainer.iteration) or {"AUC": 0.5})
    assert validated == [2, 4]


def test_a_resumed_run_keeps_better_weights_than_it_has_now(sampler, tmp_path):
    first = make(sampler, tmp_path)
    first.train(validate=lambda network: {"AUC": 0.9, "drops": 1.0})
    longer = make(sampler, tmp_path, RECIPE.scaled(2))
    assert longer.iteration == 4
    assert longer.earlier_recipe["phases"][0]["iterations"] == 2
    longer.train(validate=lambda network: {"AUC": 0.1, "drops": 9.0})
    kept = torch.load(tmp_path / "best.pt", weights_only=True)
    assert (kept["figures"]["AUC"], kept["iteration"]) == (0.9, 2)
    best, last = longer.best_network().head.residual.bias, longer.result.head.residual.bias
    assert torch.equal(best, kept["network"]["head.residual.bias"])
    assert not torch.equal(best, last)


def test_a_loss_that_is_not_finite_stops_and_its_batch_is_kept(sampler, tmp_path):
    trainer = make(sampler, tmp_path)
    trainer.train(stop=lambda: trainer.iteration == 2)
    with torch.no_grad():
        trainer.network.head.residual.bias[0] = torch.nan
    told = "loss is nan: not finite in corners.* at iteration 2, in phase 2 of 2"
    with pytest.raises(TrainingError, match=told) as raised:
        trainer.train()
    path = tmp_path / "failure-2.pt"
    assert str(path) in str(raised.value)
    assert make(sampler, tmp_path).iteration == 2  # the checkpoint is that of before

    kept = torch.load(path, weights_only=True)
    assert (kept["iteration"], kept["seed"], kept["steps"]) == (2, 0, 4)
    network = tiny_network()
    network.load_state_dict(kept["network"])
    with torch.no_grad():
        seen = Seen(network.features(kept["images"]), None, kept["looked"])
        again = network.unroll(seen, kept["steps"]).corners
    assert again.isnan()[:, 0].all()
    torch.testing.assert_close(again, kept["corners"], equal_nan=True, atol=1e-3, rtol=1e-3)
    clean = again[:, 1:] - kept["targets"][:, 1:]
    assert clean.isfinite().all()


def test_a_gradient_that_is_not_finite_stops_before_it_spoils_the_weights(sampler, tmp_path):
    trainer = make(sampler, tmp_path)
    before = weights(trainer).clone()
    trainer.network.head.residual.bias.register_hook(lambda gradient: gradient * torch.inf)
    told = r"gradient is (nan|inf), not finite in head.residual.bias at iteration 0, in phase 1"
    with pytest.raises(TrainingError, match=told):
        trainer.train()
    torch.testing.assert_close(weights(trainer), before)
    assert (tmp_path / "failure-0.pt").exists()


def test_a_stop_writes_a_checkpoint_from_which_training_goes_on(sampler, tmp_path):
    whole = make(sampler, tmp_path / "whole")
    whole.train()
    first = make(sampler, tmp_path / "stopped")
    first.train(stop=lambda: first.iteration == 3)
    second = make(sampler, tmp_path / "stopped")
    assert second.iteration == 3
    second.train()
    np.testing.assert_allclose(weights(second), weights(whole), atol=1e-6)


@pytest.mark.parametrize("learn_trunk", [False, True])
def test_the_trunk_learns_only_where_the_recipe_says_so(sampler, tmp_path, learn_trunk):
    fresh = tiny_network()
    recipe = replace(RECIPE, phases=(Phase(2, 2, 0.0, 2),), learn_trunk=learn_trunk)
    trainer = make(sampler, tmp_path, recipe)
    trainer.train()
    before, after, average = fresh.trunk, trainer.network.trunk, trainer.average.trunk
    for old, new, mean in zip(
        before.parameters(), after.parameters(), average.parameters(), strict=True
    ):
        assert torch.equal(old, new) != learn_trunk
        assert torch.equal(old, mean) != learn_trunk
    for old, new in zip(before.buffers(), after.buffers(), strict=True):
        assert torch.equal(old, new)  # statistics of batch normalisation


def test_the_last_stages_of_a_frozen_trunk_learn_at_their_share_of_the_rate(sampler, tmp_path):
    moved = {}
    for rate in (1.0, 0.1):
        fresh = tiny_network()
        recipe = replace(
            RECIPE, phases=(Phase(2, 2, 1.0, 1),), trunk_stages=1, trunk_rate=rate, weight_decay=0.0
        )
        trainer = make(sampler, tmp_path / str(rate), recipe)
        trainer.train()
        for index, (old, new, mean) in enumerate(
            zip(
                fresh.trunk.stages,
                trainer.network.trunk.stages,
                trainer.average.trunk.stages,
                strict=True,
            )
        ):
            pairs = zip(old.parameters(), new.parameters(), mean.parameters(), strict=True)
            for before, after, average in pairs:
                assert torch.equal(before, after) == torch.equal(before, average) == (index < 4)
        old, new = (n.trunk.stages[4][0].project[0].weight for n in (fresh, trainer.network))
        moved[rate] = float((new - old).detach().abs().median())
        with torch.no_grad():  # what steps see is the same whole trunk
            crops = torch.randint(0, 256, (2, 96, 96, 3), dtype=torch.uint8)
            whole = trainer.network.trunk(crops.permute(0, 3, 1, 2).float() - 127.0)
            begun = trainer.network.features(crops)
            assert torch.equal(trainer.network.trunk.finish(begun, 4)[2], whole[2])
            assert not torch.equal(begun[2], whole[2])
    assert moved[0.1] == pytest.approx(0.1 * moved[1.0], rel=0.05)  # of Adam's first step


def test_depthwise_kernels_of_a_trunk_that_learns_stay_where_the_recipe_says_so(sampler, tmp_path):
    fresh = tiny_network()
    recipe = replace(RECIPE, phases=(Phase(2, 2, 0.0, 1),), trunk_stages=1, trunk_depthwise=False)
    trainer = make(sampler, tmp_path, recipe)
    trainer.train()
    old, new = fresh.trunk.stages[4][0], trainer.network.trunk.stages[4][0]
    assert torch.equal(old.depthwise[0].weight, new.depthwise[0].weight)
    for layer in ("expand", "project"):
        assert not torch.equal(getattr(old, layer)[0].weight, getattr(new, layer)[0].weight)
    assert not torch.equal(old.depthwise[1].weight, new.depthwise[1].weight)  # the norm's


def losses_on(device, sampler, folder, own):
    """Of two iterations on a device; whatever it computes in, weights stay in single precision."""
    recipe = replace(RECIPE, phases=(Phase(2, 4, own, 2),))
    trainer = Trainer(tiny_network(), sampler, recipe, folder, device=device)
    losses = []
    trainer.train(lambda progress: losses.append(progress.loss))
    assert {p.dtype for p in trainer.network.parameters()} == {torch.float32}
    return losses


def test_mixed_precision_is_near_full_precision(sampler, tmp_path):
    full = losses_on(Device("cpu"), sampler, tmp_path / "full", own=1.0)
    mixed = losses_on(Device("cpu", mixed=True), sampler, tmp_path / "mixed", own=1.0)
    assert mixed != full
    np.testing.assert_allclose(mixed, full, rtol=0.05)


def test_in_mixed_precision_boxes_are_read_in_full(sampler, tmp_path):
    """Corners in 16 bits would lie on a grid: bfloat16 between 4 and 8 has steps of 1/32."""
    trainer = Trainer(tiny_network(), sampler, RECIPE, tmp_path, device=Device("cpu", mixed=True))
    seen: list[torch.Tensor] = []
    trainer.network.head.heat.register_forward_hook(lambda *call: seen.append(call[2]))
    learnt = trainer._step(Phase(2, 4, 0.0, 1))
    assert seen[-1].dtype == torch.float32
    assert not torch.equal(learnt.corners, learnt.corners.bfloat16().float())


@pytest.mark.slow
def test_a_compiled_pass_learns_the_same(sampler, tmp_path):
    plain = losses_on(Device("cpu"), sampler, tmp_path / "plain", own=0.5)
    compiled = losses_on(Device("cpu", compiled=True), sampler, tmp_path / "compiled", own=0.5)
    np.testing.assert_allclose(compiled, plain, rtol=1e-3)


def test_compiling_without_a_compiler_is_told(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    with pytest.raises(
        ValueError, match=r"needs a C\+\+ compiler, and none of g\+\+.*leave --comp"
    ):
        Device("cpu", compiled=True)


def test_an_unknown_device_is_refused():
    with pytest.raises(ValueError, match="unknown device 'tpu'; expected one of cpu, cuda"):
        Device("tpu")


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU here")
def test_a_gpu_that_is_not_there_is_told():
    with pytest.raises(ValueError, match="sees no GPU here; take --device cpu"):
        Device("cuda")


def test_a_checkpoint_of_another_model_is_refused(sampler, tmp_path):
    make(sampler, tmp_path).save()
    other = Re3Lite(replace(TINY, lstm_units=12))
    with pytest.raises(TrainingError, match="does not fit this model"):
        Trainer(other, sampler, RECIPE, tmp_path)


def test_only_the_parts_named_learn(sampler, tmp_path):
    before = tiny_network().head.state_dict()
    trainer = make(sampler, tmp_path, replace(RECIPE, learns=("score",)))
    trainer.train()
    after = trainer.network.head.state_dict()
    changed = {name.split(".")[0] for name in before if not torch.equal(before[name], after[name])}
    assert changed == {"score"}


def test_an_unknown_part_is_refused(sampler, tmp_path):
    with pytest.raises(TrainingError, match=r"names eyes; expected parts of the head: .*score"):
        make(sampler, tmp_path, replace(RECIPE, learns=("score", "eyes")))
