"""Two looks at every crop: as it is, and mirrored left to right."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from re3.engine.base import Engine, State, StepOutput
from re3.geometry import REGRESSION_SCALE
from re3.mirroring import LOOKS, NO_SCORE, SHARPNESS, mirrored_spec


class MirroredEngine:
    """An engine that gives the mean of what another one finds in a crop and in its mirror image.

    Either look has a recurrent state of its own; the surer one counts for more. Their errors are
    seldom the same. A step takes about twice as long.

    Args:
        engine: runs both looks, as if they were two objects.
        name: of the model that it becomes; None for that of `engine` with "@mirror" after it.
    """

    def __init__(self, engine: Engine, name: str | None = None) -> None:
        self._engine = engine
        self.spec = mirrored_spec(engine.spec, name or f"{engine.spec.name}@mirror")

    def step(
        self,
        previous_crops: NDArray[np.uint8] | None,
        current_crops: NDArray[np.uint8],
        state: Mapping[str, NDArray[np.float32]],
    ) -> StepOutput:
        """See `re3.engine.base.Engine.step`; every state is `[N, 2, ...]`."""
        output = self._engine.step(
            None if previous_crops is None else _with_mirrored(previous_crops),
            _with_mirrored(current_crops),
            {name: values.reshape(-1, *values.shape[2:]) for name, values in state.items()},
        )
        corners = output.corners.reshape(-1, LOOKS, 4).copy()
        corners[:, 1, [0, 2]] = REGRESSION_SCALE - corners[:, 1, [2, 0]]
        score = output.score.reshape(-1, LOOKS)
        share = shares(score)
        after: State = {
            name: values.reshape(-1, LOOKS, *values.shape[1:])
            for name, values in output.state.items()
        }
        return StepOutput(
            (corners * share[:, :, None]).sum(axis=1), (score * share).sum(axis=1), after
        )


def shares(score: NDArray[np.float32]) -> NDArray[np.float32]:
    """How much each look of `[N, looks]` counts; they sum to 1 for each object."""
    some = score.clip(min=NO_SCORE)
    power = (some / some.max(axis=1, keepdims=True)) ** SHARPNESS
    return power / power.sum(axis=1, keepdims=True)


def _with_mirrored(crops: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """`[N, S, S, 3]` to `[2 * N, S, S, 3]`, each followed by its mirror image."""
    return np.stack([crops, crops[:, :, ::-1]], axis=1).reshape(-1, *crops.shape[1:])
