import pytest

from re3.training.curriculum import Curriculum
from re3.training.recipe import Phase, PlateauRule, Recipe

PHASES = (Phase(2, 4, 0.0, 4), Phase(4, 2, 0.25, 3), Phase(8, 1, 0.5, 2))
AT_ONCE = PlateauRule(window=1, improvement=0.0, patience=1)
FALLING = [1.0 / (i + 1) for i in range(9)]
FLAT = [1.0] * 9


def walked(recipe, losses):
    """The phase of each iteration."""
    curriculum, phases = Curriculum(recipe), []
    for iteration, loss in enumerate(losses):
        phases.append(curriculum.index)
        curriculum.advance(iteration + 1, loss)
    return phases


@pytest.mark.parametrize(
    ("plateau", "losses", "expected"),
    [
        (None, FLAT, [0, 0, 0, 0, 1, 1, 1, 2, 2]),  # the fixed schedule looks at no loss
        (AT_ONCE, FALLING, [0, 0, 0, 0, 1, 1, 1, 2, 2]),  # never flat: each as long as it may be
        (AT_ONCE, FLAT, [0, 0, 1, 1, 2, 2, 2, 2, 2]),  # each phase has losses of its own
        (AT_ONCE, [1, 1, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3], [0, 0, 1, 1, 1, 1, 1, 2, 2]),
    ],
)
def test_phases_end_at_plateaus_or_when_they_are_up(plateau, losses, expected):
    assert walked(Recipe(phases=PHASES, plateau=plateau), losses) == expected


def test_phases_without_iterations_are_left_out():
    phases = (Phase(2, 4, 0, 0), Phase(4, 2, 0, 4), Phase(8, 1, 0, 0), Phase(16, 1, 0, 4))
    assert walked(Recipe(phases=phases, plateau=AT_ONCE), FLAT[:8]) == [1, 1, 3, 3, 3, 3, 3, 3]
    assert walked(Recipe(phases=phases), FLAT[:8]) == [1, 1, 1, 1, 3, 3, 3, 3]


@pytest.mark.parametrize("plateau", [None, AT_ONCE])
@pytest.mark.parametrize("at", range(1, 9))
def test_restored_at_any_iteration_it_goes_on(plateau, at):
    recipe = Recipe(phases=PHASES, plateau=plateau)
    first, second = Curriculum(recipe), Curriculum(recipe)
    for iteration in range(at):
        first.advance(iteration + 1, FLAT[iteration])
    second.restore(first.state(), at)
    phases = []
    for iteration in range(at, 9):
        phases.append(second.index)
        second.advance(iteration + 1, FLAT[iteration])
    assert phases == walked(recipe, FLAT)[at:]
