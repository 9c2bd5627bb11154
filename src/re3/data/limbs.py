"""Objects with limbs: parts of a cut-out that swing about a joint and are seen foreshortened.

Smooth bending (`re3.data.bending`) hardly changes what a box must hold; arms, legs, wings and
necks do, from one frame to the next.
"""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.bending import CutOut
from re3.geometry import Floats

MARGIN = 0.45
"""Room about the cut-out for limbs, as a share of its sides."""

FEWEST_PIXELS = 16
"""Opaque pixels below which an object stays in one piece."""

MOST = 3
"""Limbs of an object at most."""

SHARES = (0.1, 0.45)
"""Range of the share of the object beyond a limb's joint."""

SWING, WIDEST = 0.5, 1.3
"""Mean and largest amplitude of a limb's swing, radians."""

SHORTEST = 0.4
"""Least length at which a limb is seen, in its own."""

PERIODS = (8.0, 80.0)
"""Range of the frames that a swing takes, there and back."""

OVERLAP = 0.06
"""How far the body reaches into a limb, in the object's size: the joint stays covered."""


@dataclass(frozen=True, eq=False)
class _Limb:
    """A part of a cut-out, and how it moves."""

    alpha: NDArray[np.float32]  # [h, w], 0..1
    joint: Floats  # [2], x and y
    outward: Floats  # [2], of length 1
    angles: Floats  # [T], radians
    lengths: Floats  # [T], in its own
    before: bool  # the body, not behind it

    def path(self, frame: int) -> Floats:
        """Affine `[2, 3]`, the cut-out's pixels to those of a frame."""
        shorter = np.eye(2) + (self.lengths[frame] - 1) * np.outer(self.outward, self.outward)
        cos, sin = np.cos(self.angles[frame]), np.sin(self.angles[frame])
        matrix = np.array([[cos, -sin], [sin, cos]]) @ shorter
        return np.column_stack([matrix, self.joint - matrix @ self.joint])


def swing_limbs(
    image: NDArray[np.uint8],
    alpha: NDArray[np.uint8],
    times: NDArray[np.int64],
    rng: np.random.Generator,
) -> list[CutOut]:
    """The cut-out in every frame, its limbs swinging.

    Args:
        image: uint8 `[h, w, 3]`.
        alpha: uint8 `[h, w]`, with a transparent margin of `MARGIN`.
        times: `[T]`, when each frame is taken, in frames.
        rng: source of limbs and swings.

    Returns:
        one a frame, of the same size.
    """
    body, limbs = _cut_off(alpha, times, rng)
    pixels = image.astype(np.float32)
    frames = []
    for frame in range(len(times)):
        parts = [(limb, limb.path(frame)) for limb in limbs]
        behind = [_moved(pixels, limb.alpha, path) for limb, path in parts if not limb.before]
        before = [_moved(pixels, limb.alpha, path) for limb, path in parts if limb.before]
        frames.append(_stacked([*behind, (pixels, body), *before]))
    return frames


def _cut_off(
    alpha: NDArray[np.uint8], times: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float32], list[_Limb]]:
    """What is left of a cut-out, and its limbs."""
    rows, columns = np.nonzero(alpha > 127)
    points = np.stack([columns, rows], axis=1).astype(np.float64)
    body: NDArray[np.float32] = alpha.astype(np.float32) / np.float32(255)
    limbs: list[_Limb] = []
    if len(points) < FEWEST_PIXELS:
        return body, limbs
    size = float(np.sqrt(np.prod(np.ptp(points, axis=0) + 1)))
    across, down = np.meshgrid(np.arange(alpha.shape[1]), np.arange(alpha.shape[0]))
    for _ in range(int(rng.integers(1, MOST + 1))):
        direction = rng.uniform(0, 2 * np.pi)
        outward = np.array([np.cos(direction), np.sin(direction)])
        along = points @ outward
        joint_at = float(np.quantile(along, 1 - rng.uniform(*SHARES)))
        joint = points[np.abs(along - joint_at) <= max(1.0, 0.03 * size)].mean(axis=0)
        beyond = across * outward[0] + down * outward[1] - joint_at
        swing = min(rng.exponential(SWING), WIDEST)
        shorter = rng.uniform(0, 1 - SHORTEST)
        limbs.append(
            _Limb(
                alpha=np.where(beyond > 0, body, 0).astype(np.float32),
                joint=joint,
                outward=outward,
                angles=swing * _wave(times, rng),
                lengths=1 - shorter * (0.5 + 0.5 * _wave(times, rng)),
                before=bool(rng.random() < 0.5),
            )
        )
        body = np.where(beyond > OVERLAP * size, 0, body).astype(np.float32)
    return body, limbs


def _wave(times: NDArray[np.int64], rng: np.random.Generator) -> Floats:
    """A swing between -1 and 1 at any moment, `[T]`."""
    period = np.exp(rng.uniform(*np.log(PERIODS)))
    return np.sin(2 * np.pi * (times / period + rng.random()))


def _moved(
    pixels: NDArray[np.float32], alpha: NDArray[np.float32], path: Floats
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    size = alpha.shape[1::-1]
    image = cv2.warpAffine(pixels, path, size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(image, np.float32), np.asarray(cv2.warpAffine(alpha, path, size), np.float32)


def _stacked(
    parts: Several[tuple[NDArray[np.float32], NDArray[np.float32]]],
) -> CutOut:
    """Parts from back to front as one cut-out."""
    image, alpha = parts[0][0].copy(), parts[0][1]
    for upper, cover in parts[1:]:
        both = cover + alpha * (1 - cover)
        image += (upper - image) * (cover / np.maximum(both, 1e-3))[:, :, None]
        alpha = both
    return np.round(image).astype(np.uint8), np.round(alpha * 255).astype(np.uint8)
