"""What every engine offers: one network step with explicit state in and out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from re3.model_spec import ModelSpec

State = dict[str, NDArray[np.float32]]
"""Recurrent state of N objects: name -> float32 `[N, ...]`, shapes as in `ModelSpec.state`."""


class StepOutput(NamedTuple):
    """Result of one step of N objects."""

    corners: NDArray[np.float32]  # [N, 4], x1, y1, x2, y2 in the current crop, regression units
    score: NDArray[np.float32]  # [N], expected overlap in 0..1
    state: State


class Engine(Protocol):
    """Runs one step of a network for a batch of objects."""

    spec: ModelSpec

    def step(
        self,
        previous_crops: NDArray[np.uint8] | None,
        current_crops: NDArray[np.uint8],
        state: Mapping[str, NDArray[np.float32]],
    ) -> StepOutput:
        """One step.

        Args:
            previous_crops, current_crops: uint8 `[N, S, S, 3]` BGR, sizes as in `spec`; None for
                a network without previous crop.
            state: of the step before, zeros before the first; not to be changed in place, it may
                be needed again.
        """
        ...


def zero_state(spec: ModelSpec, objects: int) -> State:
    """The state of so many objects before their first step."""
    return {
        name: np.zeros((objects, *shape), dtype=np.float32) for name, shape in spec.state.items()
    }
