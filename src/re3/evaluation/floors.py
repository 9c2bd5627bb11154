"""Trackers that do not look: what a tracker has to be better than."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

WALK_STEP = 0.05
"""Standard deviation of the random walk's step from frame to frame, in sides of the box."""


class FirstBox:
    """The floor: the object stays where it was."""

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Keep the box."""
        self._box = np.array(box_xywh, dtype=np.float64)

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The first box, score 1."""
        return self._box, 1.0


class RandomWalk:
    """The box moves by chance, its size stays.

    Args:
        seed: of the walk; each repetition of a run has another.
    """

    def __init__(self, seed: int = 0) -> None:
        self._random = np.random.default_rng(seed)

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start at a box."""
        self._box = np.array(box_xywh, dtype=np.float64)

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The box a step further, with its centre kept in the frame; score 1."""
        height, width = frame.shape[:2]
        size = self._box[2:]
        centre = self._box[:2] + size / 2 + self._random.normal(0.0, WALK_STEP, 2) * size
        centre = np.clip(centre, 0.0, (width, height))
        self._box = np.concatenate([centre - size / 2, size])
        return self._box.copy(), 1.0
