"""Checks that configurations of data share; messages name the setting and what it may be."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any


def check_probabilities(config: Any, names: Iterable[str]) -> None:
    """Raise ValueError unless each of the settings is in 0..1."""
    for name in names:
        value = getattr(config, name)
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"{name} is {value}; expected a probability from 0 to 1")


def check_at_least_zero(config: Any, names: Iterable[str]) -> None:
    """Raise ValueError unless each of the settings is finite and 0 or more."""
    for name in names:
        value = getattr(config, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} is {value}; expected 0 or more")


def check_ranges(config: Any, names: Iterable[str]) -> None:
    """Raise ValueError unless each of the settings is a range of two numbers above 0."""
    for name in names:
        value = getattr(config, name)
        if len(value) != 2 or not 0.0 < value[0] <= value[1] < math.inf:
            raise ValueError(
                f"{name} is {list(value)}; expected two numbers above 0, the lower one first"
            )


def check_colour(config: Any, name: str) -> None:
    """Raise ValueError unless the setting is three numbers in 0..255."""
    value = getattr(config, name)
    if len(value) != 3 or not all(0.0 <= channel <= 255.0 for channel in value):
        raise ValueError(f"{name} is {list(value)}; expected blue, green and red from 0 to 255")
