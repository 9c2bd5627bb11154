"""One suite over the eleven variants of Table I at both scales: what they are, and that each can be
unrolled, exported, tracked with and trained. Sizes are tiny where something is computed."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny import TinySampler

from re3.engine.onnx_engine import OnnxEngine
from re3.geometry import search_region
from re3.model_spec import CropSpec, ModelSpec
from re3.network.base import Seen
from re3.network.cost import cost
from re3.network.export import export_onnx
from re3.network.re3 import Re3, Re3Config
from re3.network.table_one import CONFIGS, SCALES, VARIANTS
from re3.network.variants import build
from re3.network.weights import load_network, save_weights
from re3.tracker import Tracker
from re3.training.device import Device
from re3.training.features import FrozenTrunk, TorchTrunk
from re3.training.recipe import CropNoise, LossWeights, Phase, Recipe
from re3.training.rollout import roll_out
from re3.training.trainer import Trainer

LETTERS = "ABCDEFGHIJK"
SMALL = {"skips": (2, 3, 4), "fully_connected": 24, "feed_forward": 32, "lstm_units": 16}
TINY = {
    "paper": replace(SCALES["paper"], crop=CropSpec(2.0, 99), previous=CropSpec(2.0, 99), **SMALL),
    "lite": replace(SCALES["lite"], crop=CropSpec(3.0, 96), previous=CropSpec(2.0, 64), **SMALL),
}
QUIET = CropNoise(drift=0, drift_scale=0, jump=0, jump_scale=0, jumps=0, jumps_own=0, blind=0)

every_variant = pytest.mark.parametrize(
    ("scale", "letter"), [(scale, letter) for scale in SCALES for letter in LETTERS]
)


def tiny(scale, letter):
    torch.manual_seed(0)
    network = Re3(TINY[scale].config(VARIANTS[letter]))
    if scale == "lite":
        speak(network.trunk)
    return network.eval()


def speak(trunk):
    """Give random convolutions maps about 1 in size, or all crops would look the same."""
    for module in trunk.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.momentum = 1.0
        elif isinstance(module, torch.nn.Conv2d):
            torch.nn.init.kaiming_normal_(module.weight)
    with torch.no_grad():
        trunk.train()(torch.randint(0, 256, (4, 96, 96, 3), dtype=torch.uint8))


def random_crops(network, objects, steps):
    rng, spec = np.random.default_rng(0), network.spec()
    return [
        [
            torch.from_numpy(rng.integers(0, 256, (objects, c.size, c.size, 3), dtype=np.uint8))
            for c in (spec.previous, spec.current)
        ]
        for _ in range(steps)
    ]


def test_all_eleven_are_there_at_both_scales():
    assert "".join(VARIANTS) == LETTERS
    assert list(CONFIGS) == [
        f"{scale}-{letter}" for scale in ("paper", "lite") for letter in LETTERS
    ]


@pytest.mark.parametrize(
    ("letter", "layers", "skips", "own", "simulated", "large", "other", "reset"),
    [
        ("A", 0, False, False, True, False, True, False),
        ("B", 0, False, False, True, True, True, False),
        ("C", 1, False, False, False, True, True, True),
        ("D", 1, False, True, False, True, True, True),
        ("E", 1, False, True, True, True, True, True),
        ("F", 1, True, True, True, True, True, True),
        ("G", 2, True, True, True, True, True, True),
        ("H", 2, True, True, True, True, False, True),
        ("I", 2, True, True, True, False, True, True),
        ("J", 2, True, True, True, True, True, False),
        ("K", 2, True, True, True, True, True, True),
    ],
)
@pytest.mark.parametrize("scale", SCALES)
def test_the_rows_differ_as_in_the_table(
    scale, letter, layers, skips, own, simulated, large, other, reset
):
    variant, config = VARIANTS[letter], CONFIGS[f"{scale}-{letter}"]
    assert (config.lstm_layers, config.fully_connected_layers) == (layers, 1 if layers else 3)
    assert bool(config.skips) == skips
    assert (config.reset_interval == 32) == reset
    assert (variant.own_predictions, variant.simulated) == (own, simulated)
    assert (variant.large_source, variant.other_source) == (large, other)
    others = {"paper": ("caffenet", "googlenet"), "lite": ("efficientnet-lite0", "alexnet")}
    assert config.trunk == others[scale][letter == "K"]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("paper-A", 111_414_660),  # CaffeNet without skips, FC of 4096, 4096, 4096 and 4
        ("paper-C", 55_821_700),
        ("paper-F", 170_077_284),
        ("paper-G", 190_004_324),  # as the authors' large network
        ("paper-K", 174_356_244),
        ("lite-A", 6_358_628),
        ("lite-C", 3_791_588),
        ("lite-F", 6_989_980),
        ("lite-G", 8_105_116),
        ("lite-K", 10_517_756),
    ],
)
def test_parameters_at_full_size(name, parameters):
    assert cost(name).parameters == parameters


def test_the_papers_full_model_is_re3():
    assert replace(CONFIGS["paper-G"], name="re3", previous=None) == Re3Config()


def test_arithmetic_is_counted():
    # The second layer's four gates see features, the first layer and itself; three peepholes.
    second = 2 * (4 * 16 * (24 + 16 + 16) + 3 * 16 * 16)
    flops = {x: cost(TINY["lite"].config(VARIANTS[x])).flops for x in "FG"}
    assert flops["G"] - flops["F"] == second
    assert cost("lite-G").flops < cost("re3").flops


@every_variant
def test_a_step_at_full_size_has_the_shapes_of_the_spec(scale, letter):
    with torch.device("meta"):
        network = build(f"{scale}-{letter}").eval()
        spec = network.spec()
        crops = [
            torch.zeros(3, c.size, c.size, 3, dtype=torch.uint8)
            for c in (spec.previous, spec.current)
        ]
        corners, score, state = network(*crops, network.zero_state(3, "meta"))
    assert (corners.shape, score.shape) == ((3, 4), (3,))
    shapes = {name: tuple(value.shape[1:]) for name, value in state._asdict().items()}
    assert shapes == spec.state
    assert len(spec.state) == 2 * VARIANTS[letter].lstm_layers
    assert ModelSpec.from_json(spec.to_json()) == spec


@every_variant
def test_unrolled_equals_step_by_step(scale, letter):
    network, objects, steps = tiny(scale, letter), 2, 3
    crops = random_crops(network, objects, steps)
    looked = torch.zeros(objects, 4)
    with torch.no_grad():
        maps = [[network.features(crop) for crop in step] for step in crops]
        before, now = (
            tuple(torch.cat(scales) for scales in zip(*(step[i] for step in maps), strict=True))
            for i in (0, 1)
        )
        unrolled = network.unroll(Seen(now, before, looked.repeat(steps, 1)), steps)
        state, memory = network.zero_state(objects), None
        for t in range(steps):
            rows = slice(t * objects, (t + 1) * objects)
            corners, _, state = network(*crops[t], state)
            walked, memory = network.walk(Seen(maps[t][1], maps[t][0], looked), memory)
            np.testing.assert_allclose(corners, unrolled.corners[rows], atol=1e-4)
            np.testing.assert_allclose(walked, unrolled.corners[rows], atol=1e-4)
    # Crops look different, or nothing above could fail.
    assert (unrolled.corners[0] - unrolled.corners[1]).abs().max() > 1e-3
    assert unrolled.score_logit is None
    assert unrolled.heat_logits is None


@every_variant
def test_exported_it_tracks_as_torch_does(scale, letter, tmp_path):
    network = tiny(scale, letter)
    export_onnx(network, tmp_path / "n.onnx", half_weights=False)
    engine = OnnxEngine(tmp_path / "n.onnx", threads=1)
    assert engine.spec == network.spec()
    state = network.zero_state(2)
    held = {name: value.numpy() for name, value in state._asdict().items()}
    for crops in random_crops(network, 2, 2):
        with torch.no_grad():
            corners, score, state = network(*crops, state)
        output = engine.step(*(crop.numpy() for crop in crops), held)
        held = output.state
        np.testing.assert_allclose(output.corners, corners, atol=2e-3)
        assert np.isnan(output.score).all()
        assert score.isnan().all()
        for name, value in state._asdict().items():
            np.testing.assert_allclose(held[name], value, atol=1e-3)
    tracker = Tracker(engine=engine)
    frame = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    tracker.init(frame, (20, 20, 16, 16))
    for _ in range(2):
        result = tracker.update(frame)
    assert np.isfinite(result.box_xywh).all()
    assert result.frame_index == 2


class SameClips(TinySampler):
    """The same clip again and again."""

    def sample(self, frames, rng):
        return super().sample(frames, np.random.default_rng(1))


@every_variant
def test_training_lowers_the_loss(scale, letter, tmp_path):
    variant, losses = VARIANTS[letter], []
    recipe = Recipe(
        phases=(Phase(2, 2, 0.0, 8),),
        learning_rate=1e-4 if scale == "paper" else 1e-2,
        warm_up=1,
        average=0.5,
        learn_trunk=scale == "paper",
        noise=QUIET,
        loss=LossWeights(overlap=0.0),
    )
    network = tiny(scale, letter)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    trainer = Trainer(network, SameClips(), recipe, tmp_path, threads=1)
    trainer.train(lambda progress: losses.append(progress.loss))
    assert np.mean(losses[-2:]) < 0.97 * losses[0], losses
    changed = {
        name for name, value in network.state_dict().items() if not torch.equal(value, before[name])
    }
    of_trunk = [n for n in changed if n.startswith("trunk.") and "_skip." not in n]
    assert bool(of_trunk) == (scale == "paper")
    assert any("_skip." in name for name in changed) == variant.skips
    assert {"fully_connected.weight", "corners.weight"} <= changed


@pytest.mark.parametrize("letter", LETTERS)  # at the scale paper these are up to 760 MB each
def test_weights_of_named_variants_are_read_back(letter, tmp_path):
    network = build(f"lite-{letter}")
    save_weights(network, tmp_path / "w.safetensors")
    loaded = load_network(tmp_path / "w.safetensors")
    assert loaded.config == network.config
    assert torch.equal(loaded.corners.weight, network.corners.weight)


def walk(network, trunk, own):
    clips = [TinySampler().sample(4, np.random.default_rng(seed)) for seed in range(2)]
    with ThreadPoolExecutor(1) as pool:
        rng = np.random.default_rng(0)
        return clips, roll_out(clips, np.array(own), network, trunk, QUIET, rng, pool)


@pytest.mark.parametrize("scale", SCALES)
def test_previous_crops_are_of_the_frame_before_about_the_same_box(scale):
    network = tiny(scale, "G")
    clips, rollout = walk(network, TorchTrunk(network, Device()), [False, False])
    spec = network.spec()
    images = rollout.previous_images.reshape(4, 2, *rollout.previous_images.shape[1:])
    for n, clip in enumerate(clips):
        for t in range(4):
            before = max(t - 1, 0)
            region = search_region(clip.boxes_xyxy[before], spec.previous.context)
            expected = clip.crop(before, region, spec.previous.size)
            np.testing.assert_array_equal(images[t, n], expected)
    with torch.no_grad():
        maps = network.features(torch.from_numpy(rollout.previous_images))
    for got, wanted in zip(rollout.previous, maps, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-3)


def test_a_part_of_a_roll_out_has_its_previous_crops():
    network = tiny("lite", "F")
    _, rollout = walk(network, FrozenTrunk(network, 1), [True, False])
    part = rollout.part(np.array([1]))
    for whole, piece in [
        (rollout.previous[0], part.previous[0]),
        (torch.from_numpy(rollout.previous_images), torch.from_numpy(part.previous_images)),
    ]:
        torch.testing.assert_close(piece, whole.reshape(4, 2, *whole.shape[1:])[:, 1])


def test_the_frozen_trunk_has_a_graph_for_each_crop():
    network = tiny("lite", "G")
    trunk = FrozenTrunk(network, 1)
    for (crop,) in (random_crops(network, 3, 1)[0][:1], random_crops(network, 3, 1)[0][1:]):
        with torch.no_grad():
            expected = network.features(crop)
        for got, wanted in zip(trunk(crop.numpy()), expected, strict=True):
            np.testing.assert_allclose(got, wanted, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"trunk": "vgg"}, "unknown trunk 'vgg'; expected one of caffenet, googlenet"),
        ({"crop": CropSpec(2.0, 50)}, "crop size is 50; caffenet expects 67 pixels or more"),
        ({"trunk": "efficientnet-lite0"}, "crop size 227 is not a multiple"),
        ({"lstm_layers": 3}, "3 LSTM layers after 1 fully connected ones; expected 0, 1 or 2"),
        ({"fully_connected_layers": 0}, "after 0 fully connected ones"),
    ],
)
def test_sizes_that_cannot_be_are_refused(change, told):
    with pytest.raises(ValueError, match=told):
        Re3Config(**change)


def test_skips_must_fit_the_trunk():
    with pytest.raises(ValueError, match=r"skips is \(4, 8\); expected channels for 3 skips"):
        Re3(Re3Config(skips=(4, 8)))
