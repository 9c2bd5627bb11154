import math

import pytest

from re3.training.plateau import Plateau
from re3.training.recipe import PlateauRule

RULE = PlateauRule(window=4, improvement=0.1, patience=2)
NOISE = [0.3, -0.3, 0.2, -0.2]


def found_after(losses, rule=RULE):
    """The number of losses after which there is a plateau; None without any."""
    plateau = Plateau(rule)
    return next((i for i, loss in enumerate(losses, 1) if plateau.add(loss)), None)


@pytest.mark.parametrize(
    ("losses", "expected"),
    [
        ([1.0] * 20, 12),  # flat: the first window and two that are no better
        ([0.9**i for i in range(80)], None),  # falling by 34 % a window
        ([0.985**i for i in range(80)], None),  # by 6 % a window: in two windows it adds up
        ([0.998**i for i in range(80)], 12),  # by 1 % a window: too slow
        ([1.0 + i / 10 for i in range(20)], 12),  # rising
        ([1.0 + NOISE[i % 4] for i in range(20)], 12),  # noise about a flat line
        ([0.9**i + NOISE[i % 4] for i in range(12)], None),  # noise about a falling one
        ([1.0] * 8 + [0.5] * 12, 20),  # a better window starts the count again
        ([1.0] * 11, None),  # the third window is not full
        ([-1.0 - i / 4 for i in range(40)], None),  # below zero and falling
    ],
)
def test_where_a_plateau_is_found(losses, expected):
    assert found_after(losses) == expected


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (PlateauRule(window=1, improvement=0.0, patience=1), 2),
        (PlateauRule(window=5, improvement=0.0, patience=1), 10),
        (PlateauRule(window=1, improvement=0.0, patience=7), 8),
    ],
)
def test_window_and_patience_count_iterations(rule, expected):
    assert found_after([1.0] * 20, rule) == expected


@pytest.mark.parametrize("loss", [math.nan, math.inf, -math.inf])
def test_a_loss_that_is_not_finite_is_refused(loss):
    plateau = Plateau(RULE)
    plateau.add(1.0)
    with pytest.raises(ValueError, match="expected a finite number"):
        plateau.add(loss)
    assert plateau.state()["total"] == 1.0


@pytest.mark.parametrize("after", range(12))
def test_restored_at_any_moment_it_goes_on_as_if_nothing_had_happened(after):
    plateau = Plateau(RULE)
    for _ in range(after):
        plateau.add(1.0)
    resumed = Plateau(RULE)
    resumed.restore(plateau.state())
    assert [resumed.add(1.0) for _ in range(after, 12)] == [False] * (11 - after) + [True]


def test_after_a_reset_the_best_is_forgotten():
    plateau = Plateau(PlateauRule(window=1, improvement=0.0, patience=1))
    plateau.add(0.1)
    plateau.reset()
    assert not plateau.add(5.0)
    assert plateau.add(5.0)


@pytest.mark.parametrize("values", [(0, 0.1, 1), (1, 1.0, 1), (1, -0.1, 1), (1, 0.1, 0)])
def test_an_unusable_rule_is_refused(values):
    with pytest.raises(ValueError, match="not usable"):
        PlateauRule(*values)
