"""How two looks at a crop, one of them mirrored, become one: what engines and networks share."""

from __future__ import annotations

from dataclasses import replace

from re3.model_spec import ModelSpec

LOOKS = 2

SHARPNESS = 8.0
"""A look counts as its score to this power. Chosen on val: docs/experiments.md."""

NO_SCORE = 1e-6
"""Scores below count as this, so that two of 0 can be shared between."""


def mirrored_spec(once: ModelSpec, name: str) -> ModelSpec:
    """The interface of a network that looks twice, each time as described by `once`."""
    state = {part: (LOOKS, *shape) for part, shape in once.state.items()}
    return replace(once, name=name, state=state)
