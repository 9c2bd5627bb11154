"""Where to look for an object that is lost: crops about the last place it was seen at for sure.

The crop of a step reaches one box beyond the object on every side. An object that moves further, or
reappears further off, is found by looking at a few more places in each frame, nearest first.
"""

from __future__ import annotations

import numpy as np

from re3 import geometry
from re3.geometry import Floats

PLACES = 6
"""More crops a frame for each object that is searched for."""

SPACING = 1.5
"""Distance of neighbouring places in units of the box: crops three boxes wide overlap by half."""

FRAMES_A_RING = 6
"""Frames after which the search grows by a ring of places."""

RINGS = 5
"""Rings at most: the search reaches 7.5 boxes, a good part of most frames."""


def places(trusted_xyxy: Floats, searched_for: int, width: int, height: int) -> Floats:
    """Boxes to look at in one frame, of the size that the object last had.

    Each frame looks at the next few of all places within reach, so that a search goes round and
    round, and further with time.

    Args:
        trusted_xyxy: `[4]`, the box last found for sure, in pixels.
        searched_for: frames that the object has been searched for, this one included.
        width, height: of the frame in pixels.

    Returns:
        boxes_xyxy `[K, 4]`, K up to `PLACES`; centres inside the frame.
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
    turn = (searched_for - 1) * PLACES + np.arange(min(PLACES, len(centres)))
    centres = centres[turn % len(centres)]
    sizes = np.broadcast_to(size, centres.shape)
    return geometry.convert(np.concatenate([centres, sizes], axis=1), "cxcywh", "xyxy")
