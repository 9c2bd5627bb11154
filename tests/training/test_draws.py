import numpy as np
import pytest

from re3.training.draws import SequenceDraws


def drawn(seeds):
    draws = SequenceDraws([np.random.default_rng(seed) for seed in seeds])
    n = len(seeds)
    parts = [draws.laplace(0.0, 2.0, (n, 2)), draws.random(n), draws.uniform(3.0, 4.0, n)]
    return np.concatenate([part.reshape(n, -1) for part in parts], axis=1)


def test_what_a_sequence_draws_depends_on_its_seed_alone():
    together = drawn([1, 2, 3])
    np.testing.assert_array_equal(drawn([3, 1]), together[[2, 0]])
    assert len(np.unique(together)) == together.size


def test_the_numbers_are_those_of_the_distributions():
    values = drawn(range(2000))
    assert np.abs(values[:, :2]).mean() == pytest.approx(2.0, rel=0.1)  # scale of Laplace
    assert values[:, 2].mean() == pytest.approx(0.5, rel=0.1)
    assert 3.0 <= values[:, 3].min() <= values[:, 3].max() <= 4.0


def test_another_number_of_sequences_is_refused():
    with pytest.raises(ValueError, match="for 3 sequences asked of 1 generators"):
        SequenceDraws([np.random.default_rng(0)]).random(3)
