"""Images and regions of TraX as frames and boxes; the objects are those of the package vot-trax."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Box = tuple[float, float, float, float]


def image_of(image: Any) -> NDArray[np.uint8]:
    """The pixels of a TraX image, uint8 `[H, W, 3]` BGR.

    Raises:
        ValueError: it cannot be read, or is of a kind that is not known here.
    """
    kind = image.type()
    if kind == "path":
        path = image.path()
        frame = cv2.imread(path, cv2.IMREAD_COLOR)
        if frame is None:
            raise ValueError(f"{path} cannot be read as an image")
        return frame
    if kind == "memory":
        array = image.array()
        if array.dtype != np.uint8:
            raise ValueError(f"image of {array.dtype}; expected 8 bits a channel")
        code = cv2.COLOR_GRAY2BGR if array.shape[2] == 1 else cv2.COLOR_RGB2BGR
        return cv2.cvtColor(array, code)
    if kind == "buffer":
        frame = cv2.imdecode(np.frombuffer(image.buffer(), np.uint8), cv2.IMREAD_COLOR)
        if frame is None:
            raise ValueError("an image in a buffer cannot be read; expected JPEG or PNG")
        return frame
    raise ValueError(f"image of kind {kind!r}; expected path, memory or buffer")


def box_of(region: Any) -> Box:
    """The upright box around a TraX region, xywh in pixels.

    Raises:
        RuntimeError: the region is a special code or an empty mask, so there is no box.
    """
    if region.type == "rectangle":
        x, y, w, h = region.bounds()
        return float(x), float(y), float(w), float(h)
    if region.type == "polygon":
        points = np.array(list(region), dtype=np.float64)
        (x, y), (right, bottom) = points.min(axis=0), points.max(axis=0)
        return float(x), float(y), float(right - x), float(bottom - y)
    if region.type == "mask":
        rows, columns = np.nonzero(region.array())
        if rows.size:
            left, top = region.offset()
            return (
                float(left + columns.min()),
                float(top + rows.min()),
                float(np.ptp(columns) + 1),
                float(np.ptp(rows) + 1),
            )
    raise RuntimeError(f"{region} has no box; expected a rectangle, a polygon or a mask")
