"""Random numbers for the sequences of a batch, each from a generator of its own.

What is drawn for a sequence then depends on its own seed only, not on the others in the batch, so
that processes that share a batch draw what one process with the whole batch would.
"""

from __future__ import annotations

from collections.abc import Sequence as Several
from typing import Protocol

import numpy as np

from re3.geometry import Floats


class Draws(Protocol):
    """The methods of `np.random.Generator` that a roll-out needs."""

    def laplace(self, loc: float, scale: float, size: tuple[int, ...]) -> Floats: ...

    def random(self, size: int) -> Floats: ...

    def uniform(self, low: float, high: float, size: int) -> Floats: ...


class SequenceDraws:
    """Draws of N sequences at once; the first axis of every size is N.

    Args:
        generators: one for each sequence.
    """

    def __init__(self, generators: Several[np.random.Generator]) -> None:
        self.generators = generators

    def laplace(self, loc: float, scale: float, size: tuple[int, ...]) -> Floats:
        self._check(size[0])
        return np.stack([g.laplace(loc, scale, size[1:]) for g in self.generators])

    def random(self, size: int) -> Floats:
        self._check(size)
        return np.array([g.random() for g in self.generators])

    def uniform(self, low: float, high: float, size: int) -> Floats:
        self._check(size)
        return np.array([g.uniform(low, high) for g in self.generators])

    def _check(self, sequences: int) -> None:
        if sequences != len(self.generators):
            raise ValueError(
                f"numbers for {sequences} sequences asked of {len(self.generators)} generators; "
                "expected one generator a sequence"
            )
