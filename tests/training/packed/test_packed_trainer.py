"""Training from packed data: the step, the schedule, checkpoints."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from re3.data.photometric_config import NO_EFFECTS
from re3.data.sampling_config import SamplingConfig
from re3.network.lite_config import LiteState
from re3.training.errors import TrainingError
from re3.training.loss import loss_terms
from re3.training.packed.draw import ClipDrawer
from re3.training.packed.recipe import PackedRecipe, Stage
from re3.training.packed.rollout import Renderer, roll_out
from re3.training.packed.trainer import Embed, Limit, PackedTrainer
from re3.training.recipe import CropNoise, LossWeights

RECIPE = PackedRecipe(
    stages=(Stage(0.5, 2, 4, 0.5), Stage(1.0, 3, 4, 0.75)), learning_rate=3e-3, warm_up=0.1
)


@pytest.fixture
def drawer(index):
    return ClipDrawer(index, SamplingConfig(simulated=0.5, photometric=NO_EFFECTS))


def trainer_in(folder, drawer, bank, small, limit, **changes):
    network = small()
    return PackedTrainer(
        network,
        drawer,
        Renderer(bank, 127.0),
        RECIPE,
        folder,
        limit,
        torch.device("cpu"),
        **changes,
    )


@pytest.fixture
def small():
    from tiny import small_network

    return small_network


def loss_of(network, drawer, bank):
    """The loss on crops at the truth of the same clips every time."""
    clips = drawer.draw(8, 3, np.random.default_rng(99))
    own = torch.zeros(8, dtype=torch.bool)
    noise, generator = CropNoise(), torch.Generator().manual_seed(0)
    with torch.no_grad():
        rollout = roll_out(
            clips, own, network, Embed(network), Renderer(bank, 127.0), noise, generator
        )
        output = network.head.unroll(rollout.embeddings, rollout.previous_boxes, 3)
        targets = rollout.targets, rollout.has_box, rollout.hidden
        return float(loss_terms(output, *targets, LossWeights()).total)


def test_a_step_is_that_of_a_plain_walk(drawer, bank, small):
    """Loss and gradients of all steps in one batch equal those of the network step by step."""
    clips = drawer.draw(3, 4, np.random.default_rng(0))
    own = torch.tensor([True, False, True])
    found = []
    for plain in (False, True):
        network = small()
        generator = torch.Generator().manual_seed(0)
        rollout = roll_out(
            clips, own, network, Embed(network), Renderer(bank, 127.0), CropNoise(), generator
        )
        if plain:
            state = network.zero_state(3)
            outputs = []
            embeddings = rollout.embeddings.unflatten(0, (4, 3))
            for t in range(4):
                if t:
                    view = network.head.view(
                        embeddings[t - 1], rollout.previous_boxes.unflatten(0, (4, 3))[t]
                    )
                    state = LiteState(**{**state._asdict(), "view": view})
                output, state = network.head(embeddings[t], state)
                outputs.append(output)
            output = type(outputs[0])(*(torch.cat(parts) for parts in zip(*outputs, strict=True)))
        else:
            output = network.head.unroll(rollout.embeddings, rollout.previous_boxes, 4)
        terms = loss_terms(output, rollout.targets, rollout.has_box, rollout.hidden, LossWeights())
        terms.total.backward()
        found.append((terms.total, [p.grad for p in network.parameters() if p.grad is not None]))
    torch.testing.assert_close(found[0][0], found[1][0])
    for one, other in zip(found[0][1], found[1][1], strict=True):
        torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-5)


def test_training_lowers_the_loss_and_writes_what_is_needed(drawer, bank, small, tmp_path):
    trainer = trainer_in(tmp_path, drawer, bank, small, Limit(iterations=12))
    before = loss_of(trainer.network, drawer, bank)
    reports = []
    trainer.train(reports.append, checkpoint_seconds=1e9)
    log = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [entry["iteration"] for entry in log] == [1, 2, 12]
    assert loss_of(trainer.network, drawer, bank) < 0.95 * before
    assert (log[0]["unroll"], log[-1]["unroll"]) == (2, 3)
    assert trainer.pairs == 6 * 4 * 3 + 6 * 4 * 4
    assert [report.iteration for report in reports] == [1, 2, 12]
    assert (tmp_path / "checkpoint.pt").is_file()
    assert [path.name for path in tmp_path.glob("weights-*")] == ["weights-000012.safetensors"]


def test_a_stopped_run_goes_on_as_if_it_had_not_been(drawer, bank, small, tmp_path):
    whole = trainer_in(tmp_path / "whole", drawer, bank, small, Limit(iterations=4))
    whole.train()
    first = trainer_in(tmp_path / "parts", drawer, bank, small, Limit(iterations=4))
    first.train(stop=lambda: first.iteration == 2)
    assert first.iteration == 2
    second = trainer_in(tmp_path / "parts", drawer, bank, small, Limit(iterations=4))
    assert second.iteration == 2
    second.train()
    for one, other in zip(whole.average.parameters(), second.average.parameters(), strict=True):
        torch.testing.assert_close(one, other)


def test_clips_drawn_by_workers_are_the_same(drawer, bank, small, tmp_path):
    alone = trainer_in(tmp_path / "alone", drawer, bank, small, Limit(iterations=2))
    alone.train()
    many = trainer_in(tmp_path / "many", drawer, bank, small, Limit(iterations=2), workers=2)
    many.train()
    for one, other in zip(alone.average.parameters(), many.average.parameters(), strict=True):
        torch.testing.assert_close(one, other)


def test_a_time_limit_ends_the_run(drawer, bank, small, tmp_path):
    trainer = trainer_in(tmp_path, drawer, bank, small, Limit(minutes=0.02))
    trainer.train()
    assert trainer.seconds >= 1.2
    assert trainer.iteration >= 1


def test_a_loss_that_is_not_finite_ends_the_run(drawer, bank, small, tmp_path):
    trainer = trainer_in(tmp_path, drawer, bank, small, Limit(iterations=4))
    with torch.no_grad():
        trainer.network.head.residual.bias.fill_(torch.nan)
    with pytest.raises(TrainingError, match="iteration 1"):
        trainer.train()


def test_a_checkpoint_of_another_network_is_refused(drawer, bank, small, tmp_path):
    trainer_in(tmp_path, drawer, bank, small, Limit(iterations=1)).train()
    values = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    values["network"].popitem()
    torch.save(values, tmp_path / "checkpoint.pt")
    with pytest.raises(TrainingError, match="another folder"):
        trainer_in(tmp_path, drawer, bank, small, Limit(iterations=1))


@pytest.mark.parametrize(
    "progress, rate",
    [(0.0, 3e-6), (0.05, 1.5e-3), (0.1, 3e-3), (0.55, 1.5025e-3), (1.0, 5e-6)],
)
def test_the_rate_rises_and_falls(progress, rate):
    assert RECIPE.rate_at(progress) == pytest.approx(rate, rel=1e-3)


@pytest.mark.parametrize(
    "changes, word",
    [
        ({"stages": (Stage(0.5, 2, 4, 0.5),)}, "stages"),
        ({"learning_rate": 1e-9}, "learning rates"),
        ({"backbone_rate": 0.0}, "backbone_rate"),
    ],
)
def test_recipes_that_cannot_be(changes, word):
    with pytest.raises(ValueError, match=word):
        replace(RECIPE, **changes)


@pytest.mark.parametrize("values", [(None, None), (1.0, 5), (0.0, None), (None, -1)])
def test_limits_that_cannot_be(values):
    with pytest.raises(ValueError, match="expected one of them"):
        Limit(*values)
