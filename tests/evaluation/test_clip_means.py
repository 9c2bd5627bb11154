"""Means over clips and their standard errors."""

import math

import pytest

from re3.evaluation.clip_means import MeanWithError, clip_means

NAN = math.nan


@pytest.mark.parametrize(
    ("values", "mean", "error", "count"),
    [
        ([1.0, 2.0, 3.0], 2.0, 1 / math.sqrt(3), 3),  # standard deviation 1
        ([1.0, NAN, 3.0], 2.0, 1.0, 2),  # standard deviation root 2, over root 2
        ([5.0], 5.0, NAN, 1),  # one value has no spread
        ([NAN], NAN, NAN, 0),
        ([], NAN, NAN, 0),
    ],
)
def test_mean_and_standard_error(values, mean, error, count):
    found = MeanWithError.of(values)
    assert found.mean == pytest.approx(mean, nan_ok=True)
    assert found.error == pytest.approx(error, nan_ok=True)
    assert found.count == count


def test_every_clip_is_the_mean_of_its_values():
    means = clip_means([("a", 1.0), ("b", 4.0), ("a", 2.0), ("a", NAN), ("c", NAN)])
    assert list(means) == ["a", "b", "c"]
    assert (means["a"], means["b"]) == (1.5, 4.0)
    assert math.isnan(means["c"])
