"""What training sees of a sequence: boxes of every frame and crops on request.

A clip cuts crops itself, so that a simulated clip renders only the pixels that are looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3 import geometry
from re3.geometry import Floats

Kind = Literal["videos", "stills"]
"""What a source of training data holds."""


@dataclass(frozen=True, eq=False)
class Origin:
    """Where a clip of training data comes from.

    Attributes:
        source: the name of the source, or of the dataset where sources have none.
        kind: whether it was recorded, or simulated from stills.
        name: of the sequence, or of the picture that the object was cut from.
        frames: `[T]`, indices into the video of a recorded clip; None of a simulated one.
        mirrored: whether left and right are swapped.
        occluded: `[T]`, marks of the dataset; None where it marks nothing, or of a simulated clip.
    """

    source: str
    kind: Kind
    name: str
    frames: NDArray[np.int64] | None = None
    mirrored: bool = False
    occluded: NDArray[np.bool_] | None = None


class Images(Protocol):
    """Images by their number, as lists and arrays have them."""

    def __getitem__(self, index: int, /) -> NDArray[np.uint8]: ...


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

    @property
    def frame_xyxy(self) -> Floats:
        """`[4]`, the whole frame in pixels of the clip."""
        ...

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        """Cut a region of a frame out, warped to uint8 `[size, size, 3]` BGR."""
        ...

    def outline(self, frame: int, region_xyxy: ArrayLike, cells: int) -> NDArray[np.float32] | None:
        """Share of each cell of a region that shows the object, `[cells, cells]` in 0..1.

        None where only boxes are known.
        """
        ...


class RecordedClip:
    """Frames of a real video.

    Args:
        frames: uint8 `[T, H, W, 3]` BGR, or images by their number.
        boxes_xyxy: `[T, 4]` in pixels, NaN where absent.
        fill: BGR colour outside the frame.
        leaps: see `Clip`.
    """

    def __init__(
        self,
        frames: Images,
        boxes_xyxy: ArrayLike,
        fill: tuple[float, float, float],
        leaps: bool = False,
    ) -> None:
        self.leaps = leaps
        self.frames = frames
        self.boxes_xyxy = np.asarray(boxes_xyxy, dtype=np.float64)
        self.visible = np.where(np.isnan(self.boxes_xyxy[:, 0]), 0.0, 1.0)
        self.fill = fill

    @property
    def frame_xyxy(self) -> Floats:
        height, width = self.frames[0].shape[:2]
        return np.array([0.0, 0.0, width, height])

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        return geometry.crop(self.frames[frame], region_xyxy, size, self.fill)

    def outline(self, frame: int, region_xyxy: ArrayLike, cells: int) -> None:
        return None


class MirroredClip:
    """A whole track mirrored left to right (Re3, sec. III-C)."""

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self.boxes_xyxy = _mirror(clip.boxes_xyxy)
        self.visible = clip.visible
        self.leaps = clip.leaps

    @property
    def frame_xyxy(self) -> Floats:
        return _mirror(self.clip.frame_xyxy)

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        mirrored = _mirror(np.asarray(region_xyxy, dtype=np.float64))
        return np.ascontiguousarray(self.clip.crop(frame, mirrored, size)[:, ::-1])

    def outline(self, frame: int, region_xyxy: ArrayLike, cells: int) -> NDArray[np.float32] | None:
        mirrored = _mirror(np.asarray(region_xyxy, dtype=np.float64))
        outline = self.clip.outline(frame, mirrored, cells)
        return None if outline is None else np.ascontiguousarray(outline[:, ::-1])


def _mirror(boxes_xyxy: Floats) -> Floats:
    """Reflect at x = 0; where the axis lies is of no consequence, since all is relative to it."""
    return boxes_xyxy[..., [2, 1, 0, 3]] * np.array([-1.0, 1.0, -1.0, 1.0])
