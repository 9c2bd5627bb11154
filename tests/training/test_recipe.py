import pytest

from re3.training.recipe import FROZEN_TRUNK, PAPER, RECIPES, LossWeights, Phase, Recipe


@pytest.mark.parametrize("name", RECIPES)
def test_the_curriculum_is_the_papers(name):
    phases = RECIPES[name].phases
    assert [phase.unroll for phase in phases] == [2, 4, 8, 16, 32]
    assert [phase.batch for phase in phases] == [64, 32, 16, 8, 4]
    assert [phase.own for phase in phases] == [0.0, 0.25, 0.5, 0.75, 0.75]


def test_the_papers_recipe_says_what_the_paper_says():
    assert PAPER.iterations == 200_000
    assert PAPER.plateau is not None
    assert PAPER.learn_trunk
    assert PAPER.gradient_norm is None
    assert PAPER.loss == LossWeights(corners=1, overlap=0, heat=0, score=0, hidden=1)


@pytest.mark.parametrize(
    ("recipe", "iteration", "rate"),
    [
        (PAPER, 0, 1e-5),
        (PAPER, 9_999, 1e-5),
        (PAPER, 10_000, 1e-6),  # sec. III-C
        (PAPER, 199_999, 1e-6),
        (PAPER.scaled(0.1), 999, 1e-5),
        (PAPER.scaled(0.1), 1_000, 1e-6),
        (FROZEN_TRUNK, 0, 1e-5),  # 1e-3, of which the warm-up leaves a hundredth
        (FROZEN_TRUNK, 1_025, (1e-3 + 1e-5) / 2),  # half way along the cosine
        (FROZEN_TRUNK, 2_050, 1e-5),
    ],
)
def test_rate_at(recipe, iteration, rate):
    assert recipe.rate_at(iteration) == pytest.approx(rate, rel=1e-3)


@pytest.mark.parametrize(("iteration", "unroll"), [(0, 2), (9, 2), (10, 4), (14, 4)])
def test_phase_at(iteration, unroll):
    recipe = Recipe(phases=(Phase(2, 64, 0.0, 10), Phase(4, 32, 0.25, 5)))
    assert recipe.phase_at(iteration)[1].unroll == unroll
    with pytest.raises(IndexError, match="ends after 15"):
        recipe.phase_at(15)


def test_scaled_changes_nothing_but_the_iterations():
    short = FROZEN_TRUNK.scaled(0.5)
    assert short.iterations == pytest.approx(FROZEN_TRUNK.iterations / 2, abs=5)
    assert [p.unroll for p in short.phases] == [p.unroll for p in FROZEN_TRUNK.phases]


@pytest.mark.parametrize("values", [(0, 1, 0.0, 1), (1, 0, 0.0, 1), (1, 1, 1.5, 1), (1, 1, 0, -1)])
def test_an_unusable_phase_is_refused(values):
    with pytest.raises(ValueError, match="not usable"):
        Phase(*values)


def test_passes_and_parts_have_to_fit():
    with pytest.raises(ValueError, match="passes is 0"):
        Recipe(phases=(), passes=0)
    with pytest.raises(ValueError, match="batch of 6 sequences does not split into 4"):
        Recipe(phases=(Phase(2, 8, 0.0, 1), Phase(4, 6, 0.0, 1)), parts=4)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"learning_rate": 1e-6}, "expected the final one above 0 and not above the first"),
        ({"final_learning_rate": 0.0}, "expected the final one above 0"),
        ({"average": 1.0}, "average is 1.0 and seed 0"),
        ({"seed": -1}, "and seed -1"),
    ],
)
def test_settings_out_of_range_are_refused(values, told):
    with pytest.raises(ValueError, match=told):
        Recipe(phases=(), **values)
