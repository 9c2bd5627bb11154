"""Which pixels of a still picture belong to an object: from an image, from polygons, from runs.

Masks are decoded when a picture is drawn from, not before: COCO alone has 860,000.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.formats.davis import read_mask

_SUBPIXEL_BITS = 4
"""Polygons are drawn at 1/16 of a pixel."""


class Mask(Protocol):
    """The pixels of one object."""

    def read(self, width: int, height: int) -> NDArray[np.uint8]:
        """Decode it.

        Args:
            width, height: of the picture.

        Returns:
            uint8 `[height, width]`, 255 on the object and 0 elsewhere.

        Raises:
            ValueError, OSError: it cannot be read or is of another size.
        """
        ...


@dataclass(frozen=True)
class MaskImage:
    """An image that is bright, above 127, on the object."""

    path: Path

    def read(self, width: int, height: int) -> NDArray[np.uint8]:
        image = cv2.imread(str(self.path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ValueError(f"{self.path} cannot be read as an image; restore it or leave it out")
        return _as_alpha(image > 127, width, height, self.path)


@dataclass(frozen=True)
class IndexedMask:
    """A PNG image whose palette index, or grey value, is `key` on the object."""

    path: Path
    key: int

    def read(self, width: int, height: int) -> NDArray[np.uint8]:
        return _as_alpha(read_mask(self.path) == self.key, width, height, self.path)


@dataclass(frozen=True, eq=False)
class Polygons:
    """Outlines; the object is what any of them encloses.

    Attributes:
        rings: each float32 `[N, 2]`, x and y at pixel corners.
        relative: coordinates are shares of the picture's width and height.
    """

    rings: tuple[NDArray[np.float32], ...]
    relative: bool = False

    def read(self, width: int, height: int) -> NDArray[np.uint8]:
        alpha = np.zeros((height, width), dtype=np.uint8)
        scale = np.array([width, height] if self.relative else [1, 1], dtype=np.float32)
        for ring in self.rings:
            # OpenCV puts integer coordinates at pixel centres. One ring at a time: where two
            # overlap, drawn together they would cancel.
            points = np.round((ring * scale - 0.5) * (1 << _SUBPIXEL_BITS)).astype(np.int32)
            cv2.fillPoly(alpha, [points], 255, shift=_SUBPIXEL_BITS)
        return alpha


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of zeros and ones in turn, column by column, as COCO stores them.

    Attributes:
        counts: lengths of the runs, or COCO's text of them.
        size: height and width that they were made for.
    """

    counts: tuple[int, ...] | str
    size: tuple[int, int]

    def read(self, width: int, height: int) -> NDArray[np.uint8]:
        counts = run_lengths(self.counts) if isinstance(self.counts, str) else list(self.counts)
        rows, columns = self.size
        if sum(counts) != rows * columns or min(counts, default=0) < 0:
            raise ValueError(
                f"the runs of a mask are {sum(counts)} pixels long; expected {columns} x {rows}"
            )
        ones = np.arange(len(counts)) % 2 == 1
        pixels = np.repeat(ones, counts).reshape(columns, rows).T
        return _as_alpha(pixels, width, height, "a mask of runs")


def run_lengths(text: str) -> list[int]:
    """The runs that COCO's compressed text stands for.

    Every number is written in groups of five bits, lowest first, as characters from `0` on; bit 5
    says that another group follows, and bit 4 of the last one is the sign. From the fourth number
    on, what is written is the difference to the one two before.

    Raises:
        ValueError: a character that cannot stand there, or a number without its end.
    """
    counts: list[int] = []
    value = shift = 0
    for character in text:
        group = ord(character) - 48
        if not 0 <= group < 64:
            raise ValueError(
                f"{character!r} in a mask of runs; expected characters from '0' to 'o'"
            )
        value |= (group & 31) << shift
        shift += 5
        if group & 32:
            continue
        if group & 16:
            value -= 1 << shift
        counts.append(value + counts[-2] if len(counts) > 2 else value)
        value = shift = 0
    if shift:
        raise ValueError("a mask of runs breaks off within a number")
    return counts


def _as_alpha(
    pixels: NDArray[np.bool_], width: int, height: int, what: object
) -> NDArray[np.uint8]:
    if pixels.shape != (height, width):
        raise ValueError(
            f"{what} has {pixels.shape[1]} x {pixels.shape[0]} pixels; expected {width} x {height} "
            "as its picture has"
        )
    return np.where(pixels, 255, 0).astype(np.uint8)
