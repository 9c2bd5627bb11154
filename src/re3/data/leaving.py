"""Objects that go out of sight, for a while or for good.

Simulated objects wander inside their scene: without this, training hardly ever shows what a frame
looks like that the object has left, and the score does not learn to say so.
"""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence as Several
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.scene import LEAST_INSIDE, Layer, Look
from re3.geometry import Floats

FEWEST_FRAMES = 5
"""In a shorter clip there is no time to see the object, to see it go, and then to be without it."""

MANY_FRAMES = 8
"""In clips of more frames than this it is as likely as the setting says, in others half as."""

RETURNS = 0.5
"""Probability that it comes back, where the clip is long enough."""

LONGEST = 12
"""Frames that it takes to go or to come, at most; 2 at least."""

COVER = 1.1, 1.6
"""Range of the sides of what it goes behind, in units of those of its box."""


def chance_of_leaving(leaves: float, frames: int) -> float:
    """Probability that the object leaves a clip of so many frames; `leaves` is the setting."""
    if frames < FEWEST_FRAMES:
        return 0.0
    return leaves if frames > MANY_FRAMES else leaves / 2


@dataclass(frozen=True)
class Absence:
    """When an object is away, by the numbers of the frames.

    Attributes:
        last: the last frame before it begins to go.
        gone: the first without it.
        returns: the last without it, from which on it comes back; past the clip's end where it
            goes for good.
        back: the first in which it is where it would be had it never gone.
    """

    last: int
    gone: int
    returns: int
    back: int

    def way_off(self, frames: int) -> Floats:
        """`[T]`, how far it has gone in each frame, from 0 to 1."""
        marks = [self.last, self.gone, self.returns, self.back]
        return np.interp(np.arange(frames), marks, [0.0, 1.0, 1.0, 0.0])


def draw_absence(frames: int, first: int, rng: np.random.Generator) -> Absence:
    """When the object goes and whether it comes back.

    Args:
        frames: T of the clip, `FEWEST_FRAMES` or more.
        first: it is there up to this frame at least: 0, or 1 in a clip that leaps.
        rng: source of all chance.
    """
    room = frames - 2 - first  # it is away in two frames at least
    span = min(int(rng.integers(2, LONGEST + 1)), room)
    last = first + int(rng.integers(room - span + 1))
    gone = last + span
    returns = frames
    if rng.random() < RETURNS and gone + 2 < frames:
        returns = int(rng.integers(gone + 1, frames - 1))
    return Absence(last, gone, returns, returns + int(rng.integers(2, LONGEST + 1)))


def move_out(
    layers: Several[Layer],
    target: int,
    moving: Iterable[int],
    size: tuple[int, int],
    absence: Absence,
    rng: np.random.Generator,
) -> list[Layer]:
    """The layers, some of them moved so far aside that the object is out of the scene.

    Args:
        layers: of a scene.
        target: index of the object's layer.
        moving: indices of the layers that move: that one where the object walks, which it does no
            slower than before, and all where the camera turns.
        size: width and height of the scene in pixels.
        absence: when it is out, at the latest.
        rng: chooses the side, near ones more often.
    """
    chosen = set(moving)
    boxes = layers[target].boxes_xyxy()
    away = _away(boxes[absence.last : absence.returns + 1], size, rng)
    if chosen == {target}:
        centres = (boxes[1:, :2] + boxes[1:, 2:]) / 2  # the first may be long before the others
        own = float(np.hypot(*np.diff(centres, axis=0).T).mean())
        needed = int(np.ceil(np.hypot(*away) / max(own, 1e-6)))
        span = min(max(needed, 1), absence.gone - absence.last)
        absence = replace(absence, gone=absence.last + span)
    offsets = absence.way_off(len(boxes))[:, None] * away
    return [layer.moved(offsets) if i in chosen else layer for i, layer in enumerate(layers)]


def _away(boxes_xyxy: Floats, size: tuple[int, int], rng: np.random.Generator) -> Floats:
    """The way `[2]` that takes all of the boxes `[T, 4]` out of the scene over one of its sides."""
    left_top, right_bottom = boxes_xyxy[:, 2:].max(axis=0), size - boxes_xyxy[:, :2].min(axis=0)
    needed = np.maximum(np.concatenate([left_top, right_bottom]), 1.0)
    chance = needed**-2.0
    side = int(rng.choice(4, p=chance / chance.sum()))
    away = rng.normal(0.0, 0.3 * needed[side], 2)
    away[side % 2] = needed[side] * (-1.0 if side < 2 else 1.0)
    return away


def hide_behind(
    layers: Several[Layer],
    target: int,
    cover: tuple[NDArray[np.uint8], NDArray[np.uint8]],
    times: NDArray[np.int64],
    absence: Absence,
    resolution: float,
    rng: np.random.Generator,
) -> list[Layer]:
    """The layers and one more, which comes before the object and behind which that is no more.

    It is taken away when it is wholly covered. What covers it rests there: until it comes out
    again, or, where it does not, for a while. Where less than `LEAST_INSIDE` of it shows, it is
    not there either: of two equal pictures one would else say where it is and one that it is gone.

    Args:
        layers: of a scene.
        target: index of the object's layer.
        cover: image and alpha of what covers it, a rectangle or an ellipse.
        times: `[T]`, when each frame is taken, in frames.
        absence: when it is away.
        resolution: pixels of a layer's picture to one of the scene.
        rng: source of size, direction and rest.
    """
    frames, gone = len(times), absence.gone
    boxes = layers[target].boxes_xyxy()
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    object_size = boxes[gone, 2:] - boxes[gone, :2]
    size = object_size * rng.uniform(*COVER)
    image, alpha = cover
    opaque = size.copy()
    if not alpha.all():  # an ellipse: the box has to fit into it
        size = size * np.sqrt(2.0)
    pixels = np.maximum(np.minimum(size * resolution, image.shape[1::-1]), 4).astype(int)
    look = Look.cut_out(
        *(cv2.resize(i, pixels.tolist(), interpolation=cv2.INTER_AREA) for i in cover)
    )

    angle = rng.uniform(0, 2 * np.pi)
    heading = np.array([np.cos(angle), np.sin(angle)])
    # From where the two boxes just touch to where one covers the other.
    travel = ((object_size + size) / 2 / np.maximum(np.abs(heading), 1e-6)).min()
    velocity = heading * travel / (gone - absence.last)
    rests = absence.returns if absence.returns < frames else gone + int(rng.integers(frames))
    clock = np.arange(frames)
    steps = np.where(clock < gone, times - times[gone], np.maximum(clock - rests, 0))
    paths = np.zeros((frames, 2, 3))
    paths[:, [0, 1], [0, 1]] = size / pixels
    middles = centres[gone] + steps[:, None] * velocity
    paths[:, :, 2] = middles - size / 2

    comes_back = np.where(clock > absence.returns, absence.way_off(frames), 0.0)
    moved = layers[target].moved(comes_back[:, None] * (centres[gone] - centres))
    away = (gone <= clock) & (clock <= absence.returns)
    covers = np.concatenate([middles - opaque / 2, middles + opaque / 2], axis=1)
    away |= _share_in(moved.boxes_xyxy(), covers) > 1 - LEAST_INSIDE
    changed = list(layers)
    changed[target] = replace(moved, shown=~away)
    return [*changed, Layer([look], paths)]


def _share_in(boxes_xyxy: Floats, others_xyxy: Floats) -> Floats:
    """`[T]`, share of each box `[T, 4]` that is inside the other."""
    low = np.maximum(boxes_xyxy[:, :2], others_xyxy[:, :2])
    high = np.minimum(boxes_xyxy[:, 2:], others_xyxy[:, 2:])
    inside: Floats = np.prod(np.maximum(high - low, 0.0), axis=1)
    return inside / np.prod(boxes_xyxy[:, 2:] - boxes_xyxy[:, :2], axis=1)
