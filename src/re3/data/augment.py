"""Photometric augmentation of a clip: one look for the whole clip, wavering from frame to frame."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.data.clip import Clip, Origin
from re3.data.photometric_config import PhotometricConfig
from re3.geometry import Floats


class AugmentedClip:
    """A clip seen through a camera of its own.

    Args:
        clip: what is seen.
        rng: draws the look now; the looks of single frames follow from it, so that the same
            crop of the same frame always looks the same.
        config: strengths.
        origin: where the clip comes from, where that is known.
    """

    def __init__(
        self,
        clip: Clip,
        rng: np.random.Generator,
        config: PhotometricConfig | None = None,
        origin: Origin | None = None,
    ) -> None:
        config = config or PhotometricConfig()
        self.clip = clip
        self.origin = origin
        self.boxes_xyxy = clip.boxes_xyxy
        self.visible = clip.visible
        self.leaps = clip.leaps
        frames = len(clip.boxes_xyxy)
        self._seed = int(rng.integers(2**31))
        self._tables = _look_up_tables(frames, rng, config, clip.leaps)
        self._grey = rng.random() < config.grey
        self._blur = rng.uniform(0.4, 1.6) if rng.random() < config.blur else 0.0
        self._noise = rng.uniform(2.0, 10.0) if rng.random() < config.noise else 0.0
        self._quality = int(rng.integers(25, 80)) if rng.random() < config.jpeg else 0
        self._streaks = np.where(rng.random(frames) < config.motion_blur, rng.uniform(3, 11), 0.0)
        self._angles = rng.uniform(0, np.pi, frames)

    @property
    def frame_xyxy(self) -> Floats:
        return self.clip.frame_xyxy

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        image = self.clip.crop(frame, region_xyxy, size)
        if self._grey:
            image = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
        if self._blur:
            image = cv2.GaussianBlur(image, (0, 0), self._blur)
        if self._streaks[frame]:
            image = cv2.filter2D(image, -1, _streak(self._streaks[frame], self._angles[frame]))
        image = cv2.LUT(image, self._tables[frame])
        if self._noise:
            grain = np.random.default_rng([self._seed, frame, size]).normal(
                0.0, self._noise, image.shape[:2]
            )
            image = np.clip(image + grain[:, :, None], 0, 255).astype(np.uint8)
        if self._quality:
            _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self._quality])
            return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
        return image

    def outline(self, frame: int, region_xyxy: ArrayLike, cells: int) -> NDArray[np.float32] | None:
        return self.clip.outline(frame, region_xyxy, cells)


def _look_up_tables(
    frames: int, rng: np.random.Generator, config: PhotometricConfig, leaps: bool
) -> NDArray[np.uint8]:
    """Tables `[frames, 1, 256, 3]` of contrast, brightness and tint about middle grey."""
    spread = 1.0 + config.waver * rng.normal(size=(frames, 1))
    gain = np.exp(config.gain * rng.normal() * spread + config.tint * rng.normal(size=3))  # [T, 3]
    offset = config.offset * rng.normal() * spread
    if leaps:
        gain[0] *= np.exp(config.weather * rng.normal())
        offset[0] += config.offset * rng.normal()
    levels = np.arange(256.0)[None, :, None]
    values = (levels - 127.0) * gain[:, None, :] + 127.0 + offset[:, None, :]
    return np.clip(values, 0, 255).astype(np.uint8)[:, None]


def _streak(length: float, angle: float) -> NDArray[np.float32]:
    """Kernel of a straight motion blur, length in pixels."""
    side = int(length) | 1
    kernel = np.zeros((side, side), dtype=np.float32)
    middle = side // 2
    reach = np.array([np.cos(angle), np.sin(angle)]) * middle
    start, end = np.round(middle - reach).astype(int), np.round(middle + reach).astype(int)
    cv2.line(kernel, tuple(map(int, start)), tuple(map(int, end)), 1.0)
    return kernel / kernel.sum()
