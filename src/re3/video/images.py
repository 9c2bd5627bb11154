"""Frames from image files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.natural_order import natural_key
from re3.video.base import Frame, SourceError, VideoSource

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"})
IMAGES_FPS = Fraction(30)
"""Frame rate of a folder of images, which carries none."""


class ImageSource(VideoSource):
    """Images in order, read as they are asked for; their sizes may differ.

    Args:
        name: for people.
        paths: the images, in order, at least one.
        start_frame: those before are skipped.

    Raises:
        SourceError: no image `start_frame`, or it cannot be read.
    """

    def __init__(self, name: str, paths: Sequence[Path], start_frame: int = 0) -> None:
        self.name = name
        self.fps = IMAGES_FPS
        self.frame_count = len(paths)
        self._paths, self._start = paths, start_frame
        if start_frame >= len(paths):
            raise SourceError(
                f"there is no frame {start_frame}: {name} has {len(paths)} images; "
                f"expected a start frame from 0 to {len(paths) - 1}"
            )
        height, width = read_image(paths[start_frame]).shape[:2]
        self.size = (width, height)

    def __iter__(self) -> Iterator[Frame]:
        for index in range(self._start, len(self._paths)):
            yield Frame(read_image(self._paths[index]), index, float(index / self.fps))

    def close(self) -> None:
        pass


def sorted_images(paths: Iterable[Path]) -> list[Path]:
    """The images among the files, hidden ones left out, `img2` before `img10`."""
    images = (p for p in paths if is_image(p) and not p.name.startswith("."))
    # The path itself decides between img1 and img01.
    return sorted(images, key=lambda path: (natural_key(str(path)), str(path)))


def is_image(path: Path) -> bool:
    """Whether the name is that of an image."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def read_image(path: Path) -> NDArray[np.uint8]:
    """An image file as uint8 `[H, W, 3]` BGR; raises SourceError where it cannot be read."""
    try:
        # Through memory: cv2.imread cannot open every path on Windows, and prints of its own.
        data = np.fromfile(path, np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except (OSError, cv2.error) as error:
        raise SourceError(f"{path} cannot be read as an image: {error}") from error
    if image is None:
        found = f"{data.size} bytes that are no known image" if data.size else "an empty file"
        raise SourceError(f"{path} cannot be read as an image: {found}; restore it or leave it out")
    pixels: NDArray[np.uint8] = image
    return pixels
