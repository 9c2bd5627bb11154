"""Objects that change their shape: a cut-out bent differently in every frame.

The paper's simulated objects are rigid; animals and people are not, and a tracker that has only
seen rigid ones comes to hold a part of them.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

MARGIN = 0.2
"""Room about the cut-out for parts that swing out, as a share of its sides."""

MODES = 3
"""Independent smooth displacement fields of one object, each with a swing of its own."""

KNOTS = 4
"""Knots a side of the grid that a displacement field is interpolated from."""

STRONGEST = 0.12
"""Largest amplitude of a mode as a share of the sides; fields much larger would fold over."""


CutOut = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""A picture uint8 `[h, w, 3]`, and how opaque it is, uint8 `[h, w]`."""


def with_margin(image: NDArray[np.uint8], alpha: NDArray[np.uint8]) -> CutOut:
    """The cut-out in the middle of a larger, transparent one."""
    height, width = alpha.shape
    y, x = max(1, round(MARGIN * height)), max(1, round(MARGIN * width))
    return (
        cv2.copyMakeBorder(image, y, y, x, x, cv2.BORDER_REPLICATE),
        cv2.copyMakeBorder(alpha, y, y, x, x, cv2.BORDER_CONSTANT, value=(0,)),
    )


def bend(
    image: NDArray[np.uint8],
    alpha: NDArray[np.uint8],
    times: NDArray[np.int64],
    strength: float,
    rng: np.random.Generator,
) -> list[CutOut]:
    """The cut-out in every frame, its parts swinging.

    Args:
        image: uint8 `[h, w, 3]`.
        alpha: uint8 `[h, w]`, transparent at its borders (see `with_margin`).
        times: `[T]`, when each frame is taken, in frames.
        strength: mean amplitude of a mode as a share of the sides.
        rng: source of modes and swings.
    """
    height, width = alpha.shape
    sides = np.array([width, height], dtype=np.float32)
    knots = rng.normal(0.0, 1.0, (MODES, KNOTS, KNOTS, 2)).astype(np.float32)
    amplitudes = np.minimum(rng.exponential(strength, MODES), STRONGEST)
    periods = np.exp(rng.uniform(np.log(8.0), np.log(80.0), MODES))
    phases = rng.uniform(0.0, 2 * np.pi, MODES)
    swings = amplitudes * np.sin(2 * np.pi * times[:, None] / periods + phases)  # [T, modes]
    columns, rows = np.meshgrid(
        np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)
    )
    bent = []
    for swing in swings.astype(np.float32):
        coarse = np.tensordot(swing, knots, axes=1) * sides  # [knots, knots, 2] pixels
        field = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        x, y = columns + field[:, :, 0], rows + field[:, :, 1]
        bent.append(
            (
                np.asarray(
                    cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
                    dtype=np.uint8,
                ),
                np.asarray(cv2.remap(alpha, x, y, cv2.INTER_LINEAR), dtype=np.uint8),
            )
        )
    return bent
