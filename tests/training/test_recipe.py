import pytest

from re3.training.recipe import FROZEN_TRUNK, Phase, Recipe


def test_the_curriculum_is_the_papers():
    phases = FROZEN_TRUNK.phases
    assert [phase.unroll for phase in phases] == [2, 4, 8, 16, 32]
    assert [phase.batch for phase in phases] == [64, 32, 16, 8, 4]
    assert [phase.own for phase in phases] == [0.0, 0.25, 0.5, 0.75, 0.75]


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
