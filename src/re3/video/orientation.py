"""The display matrix of a recording: how its frames are turned and mirrored to be shown."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import av
import numpy as np
from av.sidedata.sidedata import Type
from numpy.typing import NDArray

_TURNED = ((1, 0, 0, 1), (0, -1, 1, 0), (-1, 0, 0, -1), (0, 1, -1, 0))
"""The matrix of a counter-clockwise turn, by quarters."""


@dataclass(frozen=True, slots=True)
class Orientation:
    """One of the eight ways in which a frame can lie on its side or be mirrored.

    Applied in the order of the fields.

    Attributes:
        transposed: rows and columns are exchanged.
        flipped_horizontally: left and right are exchanged.
        flipped_vertically: top and bottom are exchanged.
    """

    transposed: bool = False
    flipped_horizontally: bool = False
    flipped_vertically: bool = False

    @classmethod
    def of_matrix(cls, a: int, b: int, c: int, d: int) -> Orientation:
        """The orientation nearest to a display matrix.

        Args:
            a, b, c, d: the linear part: a pixel at (x, y) is shown at (a x + c y, b x + d y).
        """
        # Compared by size, as an angle between two orientations goes to the nearer one.
        if abs(b) + abs(c) > abs(a) + abs(d):
            return cls(True, c < 0, b < 0)
        return cls(False, a < 0, d < 0)

    @classmethod
    def of_frame(cls, frame: av.VideoFrame) -> Orientation:
        """The orientation that a decoded frame carries, from its container or from the stream."""
        try:
            matrix = cast(Mapping[Type, bytes], frame.side_data)[Type.DISPLAYMATRIX]
        except KeyError:
            return UPRIGHT
        except ValueError:
            # PyAV cannot list side data of a kind that it does not know, such as EXIF.
            quarters = round(frame.rotation / 90) % 4
            return cls.of_matrix(*_TURNED[quarters])
        a, b, _, c, d = struct.unpack_from("=5i", bytes(matrix))
        return cls.of_matrix(a, b, c, d)

    def applied(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image as it is to be shown; contiguous.

        Args:
            image: `[H, W, C]`.
        """
        if self == UPRIGHT:
            return image
        if self.transposed:
            image = image.transpose(1, 0, 2)
        if self.flipped_horizontally:
            image = image[:, ::-1]
        if self.flipped_vertically:
            image = image[::-1]
        return np.ascontiguousarray(image)


UPRIGHT = Orientation()
