"""Where to look for an object that is lost: near the last sure place, and where it looks alike.

The crop of a step reaches one box beyond the object on every side. An object that moves further, or
reappears further off, is found by looking at a few more places in each frame, as soon as it is
called lost: those about the place where it was last seen for sure, nearest first, and those that
look most like it, by a comparison of pixels which is cheap enough for an area many boxes wide. What
is there the network says.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from re3 import geometry
from re3.geometry import Floats

PLACES = 6
"""More crops a frame for each object that is searched for, those of what looks like it included."""

SPACING = 1.5
"""Distance of neighbouring places in units of the box: crops three boxes wide overlap by half."""

FRAMES_A_RING = 6
"""Frames after which the search grows by a ring of places."""

RINGS = 5
"""Rings at most: the search reaches 7.5 boxes, a good part of most frames."""

PATCH_SIDE = 32
"""Side of a kept patch in pixels."""

PATCH_INTERVAL = 4
"""Frames from one patch to the next: to cut one takes a thirtieth of an update."""

COMPARED_SIDE = 16
"""Frames are scaled down until objects are of about so many pixels a side, to be compared."""

COMPARED_REACH = 256
"""Compared are at most so many pixels of that scale to each side, 16 boxes of a larger object, so
that the time has a limit."""

GROWTH = 1.0
"""Larger sides of the box by which the area that is compared grows in a frame: an object may have
moved so far."""

LEAST_CONTRAST = 2.0
"""Standard deviation of grey levels (0..255) below which a patch is like anything."""

ALIKE = 2
"""Places looked at for each patch."""


def places(
    trusted_xyxy: Floats, searched_for: int, width: int, height: int, count: int = PLACES
) -> Floats:
    """Boxes to look at in one frame, of the size that the object last had.

    Each frame looks at the next few of all places within reach, so that a search goes round and
    round, and further with time.

    Args:
        trusted_xyxy: `[4]`, about where the object was last found, with the sides that it had when
            its score was last the usual one, in pixels.
        searched_for: frames on end with a score low enough for a search, this one included.
        width, height: of the frame in pixels.
        count: how many.

    Returns:
        boxes_xyxy `[K, 4]`, K up to `count`; centres inside the frame.
    """
    left, top, right, bottom = trusted_xyxy
    size = np.array([right - left, bottom - top])
    centre = np.array([left + right, top + bottom]) / 2
    reach = min(1 + (searched_for - 1) // FRAMES_A_RING, RINGS)
    steps = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offsets = offsets[np.argsort(np.square(offsets).sum(axis=1), kind="stable")]
    centres = centre + offsets * SPACING * size
    centres = centres[((centres >= 0) & (centres <= (width, height))).all(axis=1)]
    if not len(centres):
        return np.empty((0, 4))
    turn = (searched_for - 1) * count + np.arange(min(count, len(centres)))
    return _boxes_about(centres[turn % len(centres)], size)


def cut_patch(image: NDArray[np.uint8], box_xyxy: Floats) -> NDArray[np.uint8]:
    """What `alike` is to look for: the object in grey, `[PATCH_SIDE, PATCH_SIDE]`.

    Args:
        image: uint8 `[H, W, 3]`, BGR.
        box_xyxy: `[4]` in pixels.
    """
    crop = geometry.crop(image, box_xyxy, PATCH_SIDE)
    return np.asarray(cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def alike(
    image: NDArray[np.uint8],
    patches: Iterable[NDArray[np.uint8]],
    trusted_xyxy: Floats,
    searched_for: int,
) -> Floats:
    """Boxes to look at, of the size that the object last had, where the frame looks most like it.

    Likeness is the normalised cross-correlation of grey levels, whatever their mean and contrast
    (Lewis, "Fast Normalized Cross-Correlation", 1995; OpenCV's `TM_CCOEFF_NORMED`).

    Args:
        image: uint8 `[H, W, 3]`, BGR.
        patches: from `cut_patch`.
        trusted_xyxy, searched_for: as of `places`.

    Returns:
        boxes_xyxy `[K, 4]`, K up to `ALIKE` for each patch; inside the frame.
    """
    height, width = image.shape[:2]
    box_cxcywh = geometry.convert(trusted_xyxy, "xyxy", "cxcywh")
    centre, size = box_cxcywh[:2], box_cxcywh[2:]
    scale = min(1.0, COMPARED_SIDE / float(np.sqrt(size.prod())))
    reach = 1.5 * size + GROWTH * searched_for * size.max()
    reach = np.minimum(reach, COMPARED_REACH / scale)
    left, top = np.clip(centre - reach, 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(centre + reach), 0, (width, height)).astype(int)
    columns, rows = np.maximum(np.round(size * scale), 3).astype(int)
    across, down = round((right - left) * scale), round((bottom - top) * scale)
    if across < columns or down < rows:
        return np.empty((0, 4))
    area = cv2.resize(image[top:bottom, left:right], (across, down), interpolation=cv2.INTER_AREA)
    area = cv2.cvtColor(area, cv2.COLOR_BGR2GRAY)
    found = []
    for patch in patches:
        template = cv2.resize(patch, (int(columns), int(rows)), interpolation=cv2.INTER_AREA)
        if template.std() < LEAST_CONTRAST:
            continue
        likeness = cv2.matchTemplate(area, template, cv2.TM_CCOEFF_NORMED)
        for _ in range(ALIKE):
            _, best, _, (x, y) = cv2.minMaxLoc(likeness)
            if not best > 0:
                break
            # No second place that covers half of the first.
            beside, below = columns // 2, rows // 2
            likeness[max(y - below, 0) : y + below + 1, max(x - beside, 0) : x + beside + 1] = -1
            found.append((left + (x + columns / 2) / scale, top + (y + rows / 2) / scale))
    return _boxes_about(np.array(found).reshape(-1, 2), size)


def _boxes_about(centres: Floats, size: Floats) -> Floats:
    """Boxes `[K, 4]` of one width and height about centres `[K, 2]`."""
    sizes = np.broadcast_to(size, centres.shape)
    return geometry.convert(np.concatenate([centres, sizes], axis=1), "cxcywh", "xyxy")
