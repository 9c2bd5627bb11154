"""What training sees of a sequence: boxes of every frame and crops on request.

A clip cuts crops itself, so that a simulated clip renders only the pixels that are looked at.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3 import geometry
from re3.geometry import Floats


class Clip(Protocol):
    """A short sequence with one object.

    Attributes:
        boxes_xyxy: float64 `[T, 4]` in pixels of the clip; NaN where the object is absent.
        visible: float64 `[T]` in 0..1, share of the object that nothing hides, where it is known.
        leaps: the second frame was taken long before or after the first, so that the object looks
            different and may be anywhere; the others follow each other.
    """

    boxes_xyxy: Floats
    visible: Floats
    leaps: bool

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        """Cut a region of a frame out, warped to uint8 `[size, size, 3]` BGR."""
        ...


class RecordedClip:
    """Frames of a real video.

    Args:
        frames: uint8 `[T, H, W, 3]` BGR, or a list of images.
        boxes_xyxy: `[T, 4]` in pixels, NaN where absent.
        fill: BGR colour outside the frame.
        leaps: see `Clip`.
    """

    def __init__(
        self,
        frames: NDArray[np.uint8] | list[NDArray[np.uint8]],
        boxes_xyxy: ArrayLike,
        fill: tuple[float, float, float],
        leaps: bool = False,
    ) -> None:
        self.leaps = leaps
        self.frames = frames
        self.boxes_xyxy = np.asarray(boxes_xyxy, dtype=np.float64)
        self.visible = np.where(np.isnan(self.boxes_xyxy[:, 0]), 0.0, 1.0)
        self.fill = fill

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        return geometry.crop(self.frames[frame], region_xyxy, size, self.fill)


class MirroredClip:
    """A whole track mirrored left to right (Re3, sec. III-C)."""

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self.boxes_xyxy = _mirror(clip.boxes_xyxy)
        self.visible = clip.visible
        self.leaps = clip.leaps

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        mirrored = _mirror(np.asarray(region_xyxy, dtype=np.float64))
        return np.ascontiguousarray(self.clip.crop(frame, mirrored, size)[:, ::-1])


def _mirror(boxes_xyxy: Floats) -> Floats:
    """Reflect at x = 0; where the axis lies is of no consequence, since all is relative to it."""
    return boxes_xyxy[..., [2, 1, 0, 3]] * np.array([-1.0, 1.0, -1.0, 1.0])
