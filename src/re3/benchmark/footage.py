"""Frames to measure on, decoded beforehand: of a source, or made."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

Box = tuple[float, float, float, float]

SIZE = (640, 480)
"""Width and height in pixels that frames are brought to."""

PATCH = (72, 96)
"""Width and height in pixels of the made object."""


@dataclass(frozen=True, eq=False)
class Footage:
    """Frames in memory and an object in them.

    Attributes:
        name: where they are from, for people.
        frames: two or more, uint8 `[H, W, 3]` BGR.
        box_xywh: the object in the first, in pixels.
    """

    name: str
    frames: tuple[NDArray[np.uint8], ...]
    box_xywh: Box

    def __post_init__(self) -> None:
        if len(self.frames) < 2:
            raise ValueError(
                f"{self.name} has {len(self.frames)} frame to measure on; expected 2 or more, "
                "the first for the box"
            )


def read_footage(
    source: str, box_xywh: Box, count: int, size: tuple[int, int] | None = SIZE
) -> Footage:
    """The first frames of a source.

    Args:
        source: as `re3.video.open_source` takes it.
        box_xywh: the object in the first frame, in pixels of the source.
        count: frames at most.
        size: width and height to scale frames to, the box with them; None leaves them.

    Raises:
        SourceError: the source cannot be read.
        ValueError: it has a single frame.
    """
    # Made frames need no video library: its memory is not to be measured with a tracker's.
    from re3.video import SourceError, open_source

    with open_source(source) as opened:
        images = [frame.image for frame in islice(opened, count)]
    if not images:
        raise SourceError(f"{source} gave no frame; expected at least two")
    if size is not None:
        height, width = images[0].shape[:2]
        across, down = size[0] / width, size[1] / height
        x, y, w, h = box_xywh
        box_xywh = (x * across, y * down, w * across, h * down)
        images = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    return Footage(source, tuple(images), box_xywh)


def made_footage(count: int, size: tuple[int, int] = SIZE) -> Footage:
    """A checkered object that goes round before a blurred ground; the same for the same arguments.

    Args:
        count: frames, 2 or more.
        size: width and height in pixels.
    """
    width, height = size
    rng = np.random.default_rng(0)
    coarse = rng.integers(60, 200, (height // 32 + 2, width // 32 + 2, 3), dtype=np.uint8)
    ground = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    patch = _checkered(PATCH)
    frames = []
    for index in range(count):
        # A lap takes 150 frames, whose longest step is about a tenth of the object.
        angle = 2 * np.pi * index / 150
        left = round((width - PATCH[0]) / 2 + 0.25 * width * np.cos(angle))
        top = round((height - PATCH[1]) / 2 + 0.25 * height * np.sin(angle))
        frame = ground.copy()
        frame[top : top + PATCH[1], left : left + PATCH[0]] = patch
        frames.append(frame)
        if index == 0:
            box = (float(left), float(top), float(PATCH[0]), float(PATCH[1]))
    return Footage("made frames", tuple(frames), box)


def _checkered(size: tuple[int, int]) -> NDArray[np.uint8]:
    """Red and white squares about a dark bar."""
    width, height = size
    columns, rows = np.meshgrid(np.arange(width) // 12, np.arange(height) // 12)
    patch = np.where(((columns + rows) % 2)[..., None], (40, 40, 210), (235, 235, 235))
    patch = patch.astype(np.uint8)
    patch[height // 2 - 6 : height // 2 + 6] = (30, 20, 20)
    return patch
