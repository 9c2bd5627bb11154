"""How the variants of Table I are trained: recipes, lengths and sources."""

from pathlib import Path

import numpy as np
import pytest

from re3.data.frame_store import FrameStore
from re3.data.photometric_config import NO_EFFECTS
from re3.data.sampling import ClipSampler
from re3.data.sequence import Sequence
from re3.data.simulation_config import PAPER_SIMULATION
from re3.data.stills import Still
from re3.network.table_one import VARIANTS
from re3.training.ablation import (
    RECIPES,
    chosen_sources,
    shortened,
    variant_recipe,
    variant_sampler,
    video_sources,
)
from re3.training.recipe import PAPER


def track(dataset, frames, name="a"):
    boxes = np.tile([0.0, 0.0, 20.0, 20.0], (frames, 1))
    return Sequence(name, Path(f"{dataset}/{name}.mp4"), boxes, dataset=dataset)


TRACKS = [track("vid", 40), track("alov", 10), track("alov", 12, "b"), track("small", 5)]
STILL = Still(Path("a.png"), np.array([[0.0, 0.0, 9.0, 9.0]]), (None,), dataset="det")


def sampler(tmp_path, tracks=TRACKS, stills=(STILL,)):
    return ClipSampler(tracks, stills, FrameStore(tmp_path))


def test_sources_come_by_their_boxes():
    assert video_sources(TRACKS) == {"vid": 40, "alov": 22, "small": 5}


@pytest.mark.parametrize(
    ("large", "other", "expected"),
    [
        (None, None, ("vid", "alov")),
        ("alov", None, ("alov", "vid")),
        (None, "vid", ("alov", "vid")),
        (None, "small", ("vid", "small")),
        ("vid,alov", None, ("vid,alov", "small")),
        (None, "vid, small", ("alov", "vid, small")),
    ],
)
def test_which_sources_are_left_out(large, other, expected):
    assert chosen_sources(TRACKS, large, other) == expected


def test_a_single_source_has_no_other():
    assert chosen_sources([track("vid", 9)], None, None) == ("vid", "")


@pytest.mark.parametrize(
    ("tracks", "large", "other", "told"),
    [
        (TRACKS, "got", None, "no dataset of videos 'got'; there are vid, alov, small"),
        (TRACKS, "vid", "vid", "'vid' is given as both sources"),
        (TRACKS, "alov,vid", "small,vid", "'vid' is given as both sources"),
        ([], None, None, "no videos with boxes to train on"),
    ],
)
def test_sources_that_cannot_be_are_told(tracks, large, other, told):
    with pytest.raises(ValueError, match=told):
        chosen_sources(tracks, large, other)


@pytest.mark.parametrize(
    ("letter", "datasets", "simulated"),
    [
        ("A", {"alov", "small"}, True),
        ("B", {"vid", "alov", "small"}, True),
        ("C", {"vid", "alov", "small"}, False),
        ("D", {"vid", "alov", "small"}, False),
        ("G", {"vid", "alov", "small"}, True),
        ("H", {"vid", "small"}, True),
        ("I", {"alov", "small"}, True),
        ("K", {"vid", "alov", "small"}, True),
    ],
)
def test_what_a_variant_is_trained_on(tmp_path, letter, datasets, simulated):
    found = variant_sampler(VARIANTS[letter], sampler(tmp_path), "vid", "alov", "lite")
    assert {sequence.dataset for sequence in found.sequences} == datasets
    assert found.simulated == (0.6 if simulated else 0.0)
    assert found.config.leaps == 0.0


def test_the_papers_scale_draws_what_the_paper_describes(tmp_path):
    found = variant_sampler(VARIANTS["K"], sampler(tmp_path), "vid", "alov", "paper")
    config = found.config
    assert (config.leaps, config.reversed, config.strides) == (0.0, 0.0, (1,))
    assert config.photometric == NO_EFFECTS
    assert config.simulation == PAPER_SIMULATION


def test_a_source_may_be_several_datasets(tmp_path):
    found = variant_sampler(VARIANTS["I"], sampler(tmp_path), "vid,alov", "small", "lite")
    assert {sequence.dataset for sequence in found.sequences} == {"small"}


@pytest.mark.parametrize(
    ("letter", "tracks", "stills", "other", "told"),
    [
        ("E", TRACKS, (), "alov", r"variant E \(D \+ simulated data\) needs stills"),
        ("I", TRACKS[:1], (STILL,), "alov", "variant I .* needs videos besides vid"),
        ("H", TRACKS[:1], (STILL,), "", "needs two datasets of videos in --data, .* only vid"),
    ],
)
def test_a_variant_without_its_data_is_told(tmp_path, letter, tracks, stills, other, told):
    with pytest.raises(ValueError, match=told):
        variant_sampler(VARIANTS[letter], sampler(tmp_path, tracks, stills), "vid", other, "lite")


@pytest.mark.parametrize("scale", RECIPES)
@pytest.mark.parametrize("letter", "ABCDGK")
def test_own_predictions_as_in_the_table(scale, letter):
    recipe = variant_recipe(VARIANTS[letter], RECIPES[scale])
    expected = [0.0] * 5 if letter in "ABC" else [0.0, 0.25, 0.5, 0.75, 0.75]
    assert [phase.own for phase in recipe.phases] == expected
    assert [phase.unroll for phase in recipe.phases] == [2, 4, 8, 16, 32]
    assert (recipe.plateau, recipe.noise) == (None, PAPER.noise)


@pytest.mark.parametrize("iterations", [1, 2, 5, 7, 1000, 2049])
@pytest.mark.parametrize("scale", RECIPES)
def test_a_course_is_shortened_to_the_iteration(scale, iterations):
    recipe = shortened(RECIPES[scale], iterations)
    assert recipe.iterations == iterations
    for short, long in zip(recipe.phases, RECIPES[scale].phases, strict=True):
        share = long.iterations / RECIPES[scale].iterations
        assert abs(short.iterations - share * iterations) <= 1


def test_the_drop_of_the_rate_goes_along():
    assert shortened(RECIPES["paper"], 2_000).drop_at == 100
