"""What the network would change of the box that it was given, and how later boxes do without it.

Asked for the object in the very frame that it was started in, the network does not quite give the
box back: what it takes for the object reaches a little further on one side, or less far on another,
than the box that was drawn. In the frames that follow it is wrong by as much again and again, each
time from where it has got to, and so creeps to a box of its own. How wrong can be seen at the
start, where the answer is known: it looks at a few boxes beside the one given, and what it makes of
them is compared with that. Nothing is trained, four numbers are kept.

At true boxes of val and of training clips what the network changes of width and height in the eight
frames after the start is .7 to 1.2 times what it changes in the first: docs/experiments.md.
"""

from __future__ import annotations

import numpy as np

from re3.geometry import Floats

NO_BIAS: Floats = np.zeros(4)
NO_BIAS.setflags(write=False)

AWAY = 0.1
"""Sides of the box by which those looked at are moved, and the share by which they are larger and
smaller."""

_TRIED = np.array(
    [
        [AWAY, AWAY, 1 + AWAY],
        [-AWAY, -AWAY, 1 + AWAY],
        [AWAY, -AWAY, 1 / (1 + AWAY)],
        [-AWAY, AWAY, 1 / (1 + AWAY)],
    ]
)
"""Shift right and down in sides of the box, and scale."""

SHARE = 0.5
"""Of the bias that is taken off: with all of it a tracker keeps to a box that was drawn carelessly
as well as to one that was meant so. Chosen on val."""

MOST = 0.1
"""Sides of the box: a larger bias at an edge is taken for this, as of a network that is not sure of
anything. Of boxes drawn by val's rule nine in ten edges are within .022, of boxes about a part of
the object, or more than it, within .042."""


def tried_boxes(given_xyxy: Floats) -> Floats:
    """The boxes `[4, 4]` to look at in the first frame, by that given, `[4]`."""
    low, high = given_xyxy[:2], given_xyxy[2:]
    middle = (low + high) / 2 + _TRIED[:, :2] * (high - low)
    half = _TRIED[:, 2:] * (high - low) / 2
    return np.concatenate([middle - half, middle + half], axis=1)


def framing_bias(found_xyxy: Floats, given_xyxy: Floats) -> Floats:
    """How far each edge of later boxes has to be moved back.

    Args:
        found_xyxy: `[4, 4]`, what the network finds from each of `tried_boxes`, in pixels.
        given_xyxy: `[4]`, the box that it was started with.

    Returns:
        `[4]`: left, top, right, bottom in sides of the box, to the right and down positive.
    """
    bias = (found_xyxy.mean(axis=0) - given_xyxy) / _sides(given_xyxy)
    return SHARE * np.clip(bias, -MOST, MOST)


def without_bias(boxes_xyxy: Floats, bias: Floats) -> Floats:
    """Boxes as they are when framed like the box given.

    Args:
        boxes_xyxy: `[N, 4]` in pixels, as the network finds them; NaN stays NaN.
        bias: `[N, 4]`, of each, from `framing_bias`.
    """
    with np.errstate(invalid="ignore"):  # the boxes of a network gone astray
        return boxes_xyxy - bias * _sides(boxes_xyxy)


def _sides(boxes_xyxy: Floats) -> Floats:
    """Width, height, width, height of boxes `[..., 4]`."""
    return np.tile(boxes_xyxy[..., 2:] - boxes_xyxy[..., :2], 2)
