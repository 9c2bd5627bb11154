"""Draws what the cameras of clips do: contrast, blur, noise and compression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.data.photometric_config import PhotometricConfig
from re3.geometry import Floats

KERNEL = 11
"""Side of a blur's kernel in pixels of the crop."""
POINTS = 7
"""Points along a streak of motion blur."""
SHARPEST = 0.35
"""Standard deviation, in pixels, of a blur along nothing but a streak."""
MARGIN = 1.4
"""Room for more clips with an effect than are expected in a batch; those beyond it go without."""
UNCOMPRESSED = 100.0


@dataclass(frozen=True, eq=False)
class Lens:
    """Camera effects of N clips of T frames; see `re3.training.packed.clips.ClipBatch`."""

    gain: Floats
    offset: Floats
    grey: NDArray[np.bool_]
    noise: Floats
    blurred: NDArray[np.int64]
    kernels: Floats
    compressed: NDArray[np.int64]
    quality: Floats


def draw_lens(
    clips: int,
    frames: int,
    leaps: NDArray[np.bool_],
    config: PhotometricConfig,
    rng: np.random.Generator,
) -> Lens:
    """Effects of so many clips and frames.

    Args:
        clips, frames: N and T.
        leaps: `[N]`, a first frame of other weather.
        config: strengths and probabilities.
        rng: source of all chance.
    """
    n, t = clips, frames
    spread = 1.0 + config.waver * rng.normal(size=(t, n))
    gain = np.exp(
        (config.gain * rng.normal(size=n) * spread)[..., None]
        + config.tint * rng.normal(size=(n, 3))
    )
    offset = config.offset * rng.normal(size=n) * spread
    gain[0] *= np.exp(config.weather * rng.normal(size=n) * leaps)[:, None]
    offset[0] += config.offset * rng.normal(size=n) * leaps
    soft = np.where(rng.random(n) < config.blur, rng.uniform(0.4, 1.6, n), 0.0)
    streaks = np.where(rng.random((t, n)) < config.motion_blur, rng.uniform(3, 11, (t, n)), 0.0)
    quality = np.where(rng.random(n) < config.jpeg, rng.uniform(25, 80, n), UNCOMPRESSED)
    blurred = _first((soft > 0) | (streaks > 0), config.blur + config.motion_blur, rng)
    frame = np.arange(t)[:, None]
    compressed = _first((quality < UNCOMPRESSED)[None], config.jpeg, rng)[0]
    return Lens(
        gain=gain,
        offset=offset,
        grey=rng.random(n) < config.grey,
        noise=np.where(rng.random(n) < config.noise, rng.uniform(2.0, 10.0, n), 0.0),
        blurred=blurred,
        kernels=_kernels(
            soft[blurred], streaks[frame, blurred], rng.uniform(0, np.pi, blurred.shape)
        ),
        compressed=compressed,
        quality=quality[compressed],
    )


def _first(
    wanted: NDArray[np.bool_], expected: float, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Of each row `[T, N]` the same number of places, those that are wanted first."""
    clips = wanted.shape[1]
    count = min(clips, int(np.ceil(expected * MARGIN * clips)))
    order = np.argsort(~wanted + rng.random(wanted.shape) * 0.5, axis=1)
    return order[:, :count].astype(np.int64)


def _kernels(soft: Floats, streaks: Floats, angles: Floats) -> Floats:
    """Blur kernels `[..., KERNEL, KERNEL]`: a Gaussian drawn along a streak.

    Where there is neither, the kernel leaves the picture as it is.
    """
    along = np.linspace(-0.5, 0.5, POINTS) * np.maximum(streaks - 1.0, 0.0)[..., None]
    x, y = along * np.cos(angles)[..., None], along * np.sin(angles)[..., None]
    sigma = np.maximum(soft, np.where(streaks > 0, SHARPEST, 0.01))[..., None, None]
    grid = np.arange(KERNEL) - KERNEL // 2
    column = np.exp(-0.5 * ((grid - x[..., None]) / sigma) ** 2)  # [..., P, K]
    row = np.exp(-0.5 * ((grid - y[..., None]) / sigma) ** 2)
    kernels = np.einsum("...pi,...pj->...ij", row, column)
    return kernels / kernels.sum(axis=(-2, -1), keepdims=True)
