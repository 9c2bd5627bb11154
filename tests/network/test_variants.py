"""Every variant: shapes, sizes, batching, unrolling, and weights in and out."""

from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch

from re3.model_spec import ModelSpec
from re3.network.export import export_onnx
from re3.network.lite_blocks import Adapter, sample_region
from re3.network.lite_config import LiteConfig
from re3.network.mirrored import LOOK
from re3.network.re3 import Re3Config
from re3.network.variants import VARIANTS, build
from re3.network.weights import load_network, save_weights

SMALL = [
    Re3Config(fully_connected=24, lstm_units=16),
    LiteConfig(fully_connected=24, lstm_units=16, fused=16, embedding=16, correlation=8),
]


def random_inputs(network, objects, steps=1, seed=0):
    spec, rng = network.spec(), np.random.default_rng(seed)
    return [
        tuple(
            torch.from_numpy(rng.integers(0, 256, (objects, c.size, c.size, 3), dtype=np.uint8))
            for c in (spec.previous, spec.current)
            if c is not None
        )
        for _ in range(steps)
    ]


@pytest.fixture(params=SMALL, ids=lambda config: config.name)
def network(request):
    torch.manual_seed(0)
    network = build(request.param).eval()
    # Readouts start silent; give them a voice, so that comparisons can fail.
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.ndim > 1 and not parameter.any():
                parameter.normal_(std=0.3)
    return network


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("re3", 190_004_324),  # as the authors' large network
        ("re3-lite", 5_178_952),
        ("re3-look", 5_179_752),
    ],
)
def test_parameter_count(name, parameters):
    with torch.device("meta"):
        network = build(name)
    assert sum(p.numel() for p in network.parameters()) == parameters


@pytest.mark.parametrize("config", VARIANTS.values(), ids=lambda config: config.name)
def test_spec_survives_json(config):
    assert ModelSpec.from_json(config.spec().to_json()) == config.spec()


def test_step_shapes(network):
    (crops,) = random_inputs(network, objects=3)
    with torch.no_grad():
        corners, score, state = network(*crops, network.zero_state(3))
    assert corners.shape == (3, 4)
    assert score.shape == (3,)
    shapes = {name: tuple(value.shape[1:]) for name, value in state._asdict().items()}
    assert shapes == network.spec().state


def test_a_batch_equals_single_steps(network):
    steps = random_inputs(network, objects=3, steps=3)
    state = network.zero_state(3)
    singles = [network.zero_state(1) for _ in range(3)]
    with torch.no_grad():
        for crops in steps:
            corners, score, state = network(*crops, state)
            for i in range(3):
                own = [crop[i : i + 1] for crop in crops]
                one, one_score, singles[i] = network(*own, singles[i])
                np.testing.assert_allclose(one[0], corners[i], atol=1e-4)
                np.testing.assert_allclose(one_score[0], score[i], atol=1e-4)


def test_fresh_adapters_are_silent():
    fresh = build(SMALL[1])
    adapters = [module for module in fresh.modules() if isinstance(module, Adapter)]
    assert len(adapters) == 3
    for adapter in adapters:
        maps = torch.randn(2, adapter.contract.out_channels, 6, 6)
        assert torch.equal(adapter(maps), maps)
        torch.nn.init.normal_(adapter.contract.weight)
        assert not torch.allclose(adapter(maps), maps)


def test_the_state_matters(network):
    first, second = random_inputs(network, objects=1, steps=2)
    with torch.no_grad():
        _, _, state = network(*first, network.zero_state(1))
        with_state, _, _ = network(*second, state)
        without, _, _ = network(*second, network.zero_state(1))
    assert (with_state - without).abs().max() > 1e-4


def test_unrolled_equals_step_by_step():
    torch.manual_seed(0)
    network = build(SMALL[1]).eval()
    torch.nn.init.normal_(network.head.modulate.weight, std=0.1)
    steps, objects = 4, 2
    inputs = random_inputs(network, objects, steps)
    with torch.no_grad():
        embeddings = [network.head.embedding(network.features(crop)) for (crop,) in inputs]
        looked = torch.rand(steps * objects, 4) + torch.tensor([2.0, 2.0, 6.0, 6.0])
        unrolled = network.head.unroll(torch.cat(embeddings), looked, steps)
        state, before = network.zero_state(objects), None
        for t, embedding in enumerate(embeddings):
            rows = slice(t * objects, (t + 1) * objects)
            if before is not None:
                state = state._replace(view=network.head.view(before, looked[rows]))
            before = embedding
            output, state = network.head(before, state)
            np.testing.assert_allclose(output.corners, unrolled.corners[rows], atol=1e-4)
            np.testing.assert_allclose(output.score_logit, unrolled.score_logit[rows], atol=1e-4)


@pytest.mark.parametrize("stages", [0, 1, 2, 3])
def test_stages_of_the_trunk_that_learn_change_nothing_before_they_do(stages):
    torch.manual_seed(0)
    network = build(SMALL[1]).eval()
    crops, state = random_inputs(network, objects=2, steps=1)[0], network.zero_state(2)
    with torch.no_grad():
        expected = network(*crops, state)
        network.trunk.requires_grad_(False)
        network.let_trunk_learn(stages)
        found = network(*crops, state)
    for a, b in zip((*found[:2], *found[2]), (*expected[:2], *expected[2]), strict=True):
        torch.testing.assert_close(a, b)
    learning = {n.split(".")[1] for n, p in network.trunk.named_parameters() if p.requires_grad}
    assert learning == {str(index) for index in range(5 - stages, 5)}


@pytest.mark.parametrize(
    ("name", "stages", "told"),
    [
        (SMALL[1], 4, "4 stages of the trunk are to learn; expected 0 to 3"),
        (SMALL[1], -1, "expected 0 to 3"),
        ("lite-C", 1, "'lite-C' has no stages of its trunk that learn apart"),
    ],
)
def test_stages_that_cannot_learn_apart_are_told(name, stages, told):
    with pytest.raises(ValueError, match=told):
        build(name).let_trunk_learn(stages)


def test_weights_survive_safetensors_bit_exactly(tmp_path):
    network = build("re3-lite")
    save_weights(network, tmp_path / "w.safetensors")
    loaded = load_network(tmp_path / "w.safetensors")
    assert loaded.config == network.config
    for (name, a), (_, b) in zip(
        network.state_dict().items(), loaded.state_dict().items(), strict=True
    ):
        assert torch.equal(a, b), name


def test_weights_without_what_is_only_learnt_begin_it_anew(tmp_path):
    network = build("re3-lite")
    with torch.no_grad():
        network.head.outline.weight.fill_(1.0)
    path = tmp_path / "exported.onnx"
    export_onnx(network, path, half_weights=False)
    loaded = load_network(path)
    assert not loaded.head.outline.weight.any()
    assert torch.equal(loaded.head.heat.weight, network.head.heat.weight)
    assert "outline" not in str(onnx.load(path).graph.node)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "cannot be read"),  # empty
        (b"not safetensors at all", "cannot be read"),
    ],
)
def test_a_broken_weights_file_is_named(tmp_path, content, message):
    path = tmp_path / "broken.safetensors"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"broken\.safetensors.*{message}"):
        load_network(path)


def test_a_re3_lite_of_before_it_was_lean_is_a_look_of_re3_base(tmp_path):
    network = build(LiteConfig(lean=False))  # under the name that such files have
    with torch.no_grad():
        network.head.fuse[1].weight.uniform_()
    save_weights(network, tmp_path / "old.safetensors")
    loaded = load_network(tmp_path / "old.safetensors")
    assert loaded.config == LOOK
    assert torch.equal(loaded.head.fuse[1].weight, network.head.fuse[1].weight)


def test_weights_of_another_size_are_refused(tmp_path):
    network = build(replace(LiteConfig(), lstm_units=16))
    save_weights(network, tmp_path / "w.safetensors")
    with pytest.raises(ValueError, match=r"do not fit 're3-lite'.*of another shape"):
        load_network(tmp_path / "w.safetensors")


def test_an_unknown_variant_is_refused():
    with pytest.raises(ValueError, match="unknown variant 're4'; expected one of re3, re3-lite"):
        build("re4")


def test_a_view_wider_than_the_crop_is_refused():
    with pytest.raises(ValueError, match=r"view is 4\.0 boxes wide.*current crop's 3\.0"):
        LiteConfig(view=4.0)


def test_a_view_is_the_part_of_the_embedding_about_the_box():
    head = build(SMALL[1]).head
    embedding = torch.randn(2, 16, 24, 24)
    still = torch.tensor([[10 / 3, 10 / 3, 20 / 3, 20 / 3]]).repeat(2, 1)
    torch.testing.assert_close(head.view(embedding, still), head.first_view(embedding))
    cell = torch.tensor([[10 / 24, 20 / 24] * 2])  # one cell to the right, two down
    moved = head.view(embedding, still + cell)
    torch.testing.assert_close(moved, embedding[:, :, 6:22, 5:21], atol=1e-4, rtol=0)


def test_a_view_that_reaches_outside_is_zero_there():
    view = sample_region(torch.ones(1, 1, 24, 24), torch.tensor([[0.5, 0.5, 1.5, 1.5]]), 16)
    assert (view[..., :7, :7] > 0.99).all()
    assert (view[..., 9:, :] == 0).all()
    assert (view[..., 9:] == 0).all()


def test_a_coarse_view_averages():
    maps = torch.randn(1, 3, 24, 24)
    view = sample_region(maps, torch.tensor([[0.0, 0.0, 1.0, 1.0]]), 2)
    assert view.shape == (1, 3, 2, 2)
    one = sample_region(torch.ones(1, 1, 24, 24), torch.tensor([[0.25, 0.25, 0.75, 0.75]]), 2)
    torch.testing.assert_close(one, torch.ones(1, 1, 2, 2))


def test_the_view_of_the_first_frame_is_about_the_box_given():
    torch.manual_seed(0)
    head = build(SMALL[1]).eval().head
    with torch.no_grad():
        head.residual.bias.fill_(2.0)  # finds another box than the one given
        embedding = torch.randn(1, 16, 24, 24)
        _, state = head(embedding, head.zero_state(1))
        torch.testing.assert_close(state.view, head.first_view(embedding))
        output, state = head(embedding, state)
        torch.testing.assert_close(state.view, output.view)
        assert not torch.allclose(output.view, head.first_view(embedding))
