"""Crops about regions of whole pixels, as the tracker of the paper's authors takes them.

Networks with `whole_pixels` in their `re3.model_spec.ModelSpec` were trained on crops of this kind.
The part of the region inside the frame is resized, and the rest of the crop is filled afterwards.
Both are rounded to whole pixels of the crop, so that a crop over the frame's border may be up to a
pixel off the place where the region has it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray


def whole_pixel_crop(
    image: NDArray[np.uint8],
    region_xyxy: ArrayLike,
    size: int,
    fill: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> NDArray[np.uint8]:
    """Cut a region, rounded to whole pixels, out of an image and resize it to a square.

    Linear interpolation without averaging: of a region that is much larger than the crop, not every
    pixel counts.

    Args:
        image: uint8 `[H, W, 3]`.
        region_xyxy: `[4]` in pixels, finite; halves are rounded to even numbers. May reach outside
            the image, or lie outside altogether.
        size: side of the square crop in pixels.
        fill: the colour outside the image.

    Returns:
        uint8 `[size, size, 3]`.
    """
    limits = np.array([image.shape[1], image.shape[0]])
    low, high = np.rint(np.asarray(region_xyxy, dtype=np.float64)).astype(np.int64).reshape(2, 2)
    extent = np.maximum(high - low, 1)  # a crop needs something to cut
    inside_low = np.clip(low, 0, limits)
    inside = np.clip(low + extent, 0, limits) - inside_low
    crop = np.full((size, size, 3), fill, dtype=np.uint8)
    if not inside.all():
        return crop
    columns, rows = np.maximum(np.rint(size * inside / extent), 1).astype(int)
    left, top = np.maximum(-low, 0) * size // extent
    (x, y), (width, height) = inside_low, inside
    crop[top : top + rows, left : left + columns] = cv2.resize(
        image[y : y + height, x : x + width],
        (int(columns), int(rows)),
        interpolation=cv2.INTER_LINEAR,
    )
    return crop
