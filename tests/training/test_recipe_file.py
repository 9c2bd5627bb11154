import re
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from re3.training.recipe import FROZEN_TRUNK, PAPER, RECIPES, CropNoise, Phase, PlateauRule
from re3.training.recipe_file import (
    differences,
    find_packed_recipe,
    find_recipe,
    read_recipe,
    recipe_yaml,
)


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_written_is_read_back_the_same(file, name):
    assert find_recipe(name) == RECIPES[name]
    assert find_recipe(str(file(recipe_yaml(RECIPES[name])))) == RECIPES[name]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("passes: 3", replace(FROZEN_TRUNK, passes=3)),
        ("base: paper\nseed: 7", replace(PAPER, seed=7)),
        ("learning_rate: 5e-4", replace(FROZEN_TRUNK, learning_rate=5e-4)),  # text in YAML 1.1
        ("noise: {drift: 0}", replace(FROZEN_TRUNK, noise=CropNoise(drift=0.0))),  # others stay
        ("gradient_norm: null", replace(FROZEN_TRUNK, gradient_norm=None)),
        ("plateau: {window: 9}", replace(FROZEN_TRUNK, plateau=PlateauRule(window=9))),
        ("base: paper\nplateau: null", replace(PAPER, plateau=None)),
        (
            "base: paper\nplateau: {patience: 9}",
            replace(PAPER, plateau=replace(PAPER.plateau, patience=9)),
        ),
        ("learn_trunk: true", replace(FROZEN_TRUNK, learn_trunk=True)),
        (
            "trunk_stages: 2\ntrunk_rate: 0.3\ntrunk_depthwise: false",
            replace(FROZEN_TRUNK, trunk_stages=2, trunk_rate=0.3, trunk_depthwise=False),
        ),
        ("learns: [score]", replace(FROZEN_TRUNK, learns=("score",))),
        (
            "phases: [{unroll: 2, batch: 8, own: 0.5, iterations: 10}]",
            replace(FROZEN_TRUNK, phases=(Phase(2, 8, 0.5, 10),)),
        ),
    ],
)
def test_fields_change_the_base(file, text, expected):
    assert read_recipe(file(text)) == expected


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("learning_rat: 1", "unknown key learning_rat; expected one of phases, plateau, learning"),
        ("noise: {drift: 1, sway: 2}", r"unknown key noise.sway; expected one of drift, drift_sc"),
        (
            "phases: [{unroll: 2, batch: 8, own: 0, iterations: 1, rate: 3}]",
            r"unknown key phases\[0\].rate; expected one of unroll, batch, own, iterations",
        ),
        ("phases: [{unroll: 2, own: 0}]", r"phases\[0\] lacks batch, iterations"),
        ("phases: 3", "phases is 3; expected a list"),
        ("learns: [3]", r"learns\[0\] is 3; expected a name"),
        ("phases: [3]", r"phases\[0\] is 3; expected keys and values"),
        ("passes: 1.5", "passes is 1.5; expected a whole number"),
        ("passes: true", "passes is True; expected a whole number"),
        ("learning_rate: fast", "learning_rate is 'fast'; expected a number"),
        ("learn_trunk: 1", "learn_trunk is 1; expected true or false"),
        ("trunk_stages: -1", "trunk_stages is -1 and trunk_rate 1.0; expected 0 stages or more"),
        ("trunk_rate: 0", "expected 0 stages or more and a share above 0 and up to 1"),
        ("base: paper\ntrunk_stages: 1", "learn_trunk, and trunk_stages 1: expected one of them"),
        ("seed: null", "seed is nothing; expected a whole number"),
        ("passes: 0", "passes is 0; expected 1 or more"),  # the recipe's own checks
        ("base: papers", "base is 'papers'; expected one of frozen-trunk, paper"),
        ("- passes", "holds .*; expected fields of a recipe"),
        ("", "holds nothing; expected fields of a recipe"),
        ("passes: [", "cannot be read as YAML"),
        pytest.param("passes: " + 20_000 * "[", "nested too deeply", id="nested"),
    ],
)
def test_what_does_not_fit_is_told_with_the_file(file, text, told):
    with pytest.raises(ValueError, match=told) as raised:
        read_recipe(file(text))
    assert "mine.yaml" in str(raised.value)


def test_a_recipe_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ValueError, match="no recipe 'fast'; expected one of frozen-trunk, paper"):
        find_recipe("fast")
    with pytest.raises(FileNotFoundError, match=r"gone\.yaml does not exist"):
        find_recipe(str(tmp_path / "gone.yaml"))


def test_differences_name_the_fields():
    other = replace(PAPER, passes=2, noise=replace(PAPER.noise, blind=0.5))
    told = differences(asdict(PAPER), asdict(other))
    assert [line.partition(" ")[0] for line in told] == ["passes", "noise"]
    assert told[0] == "passes 1 -> 2"
    assert differences(asdict(PAPER), asdict(PAPER)) == []


def test_the_packed_recipe_of_the_docs_can_be_read(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "training.md"
    (block,) = [
        text
        for text in re.findall(r"```yaml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
        if "stages:" in text
    ]
    (tmp_path / "recipe.yaml").write_text(block)
    recipe = find_packed_recipe(str(tmp_path / "recipe.yaml"))
    assert [stage.unroll for stage in recipe.stages] == [4, 8]
    assert recipe.noise == find_packed_recipe("gpu").noise
