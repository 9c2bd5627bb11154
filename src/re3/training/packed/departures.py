"""Simulated objects that go out of sight in batches of scenes; see `re3.data.leaving` for one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from re3.data.leaving import COVER, draw_absence
from re3.data.scene import LEAST_INSIDE
from re3.geometry import Floats
from re3.training.packed.clips import ELLIPSE, LAYERS, TARGET

if TYPE_CHECKING:
    from re3.training.packed.scenes import CutOuts, Scenes


def leave(
    scenes: Scenes,
    ways: dict[int, str],
    times: NDArray[np.int64],
    covers: CutOuts,
    rng: np.random.Generator,
) -> None:
    """Let the objects of some scenes go out of sight, in half of the cases for good.

    Args:
        scenes: changed in place.
        ways: how, for the scenes that it happens in: it "walks" out, the "camera" turns away, or
            it goes "behind" something.
        times: `[N, T]`, when each frame is taken, in frames.
        covers: what an object goes behind, one for each scene.
        rng: source of all chance.
    """
    frames = scenes.boxes_xyxy.shape[0]
    for row, way in ways.items():
        leaps = int(times[row, 1] - times[row, 0] > 1)
        absence = draw_absence(frames, leaps, rng)
        boxes = scenes.boxes_xyxy[:, row]
        if way == "behind":
            _hide(scenes, row, times[row], covers, absence.gone, absence.returns, rng)
            continue
        away = _way_out(boxes[absence.last : absence.returns + 1], scenes.size[row], rng)
        offsets = absence.way_off(frames)[:, None] * away
        layers = range(LAYERS) if way == "camera" else (TARGET,)
        for layer in layers:
            scenes.to_scene[:, row, layer, :, 2] += offsets
        boxes += np.tile(offsets, 2)


def _way_out(boxes_xyxy: Floats, size: Floats, rng: np.random.Generator) -> Floats:
    """The way `[2]` that takes all of the boxes out of the scene, over a near side more often."""
    left_top, right_bottom = boxes_xyxy[:, 2:].max(axis=0), size - boxes_xyxy[:, :2].min(axis=0)
    needed = np.maximum(np.concatenate([left_top, right_bottom]), 1.0)
    chance = needed**-2.0
    side = int(rng.choice(4, p=chance / chance.sum()))
    away = rng.normal(0.0, 0.3 * needed[side], 2)
    away[side % 2] = needed[side] * (-1.0 if side < 2 else 1.0)
    return away


def _hide(
    scenes: Scenes,
    row: int,
    times: NDArray[np.int64],
    covers: CutOuts,
    gone: int,
    returns: int,
    rng: np.random.Generator,
) -> None:
    """Put a cover before an object, which is not shown from `gone` to `returns`."""
    boxes = scenes.boxes_xyxy[:, row]
    frames, layer = len(boxes), LAYERS - 1
    middles = (boxes[:, :2] + boxes[:, 2:]) / 2
    object_size = boxes[gone, 2:] - boxes[gone, :2]
    size = object_size * rng.uniform(*COVER)
    opaque = size
    if covers.opaque[row] == ELLIPSE:  # the box has to fit into it
        size = size * np.sqrt(2.0)
    angle = rng.uniform(0, 2 * np.pi)
    heading = np.array([np.cos(angle), np.sin(angle)])
    # From where the two boxes just touch to where one covers the other.
    travel = ((object_size + size) / 2 / np.maximum(np.abs(heading), 1e-6)).min()
    velocity = heading * travel / max(1, gone - 1)
    rests = returns if returns < frames else frames
    clock = np.arange(frames)
    steps = np.where(clock < gone, times - times[gone], np.maximum(clock - rests, 0))
    places = middles[gone] + steps[:, None] * velocity
    rectangle = covers.rectangle[row]
    maps = np.zeros((frames, 2, 3))
    maps[:, [0, 1], [0, 1]] = size / (rectangle[2:] - rectangle[:2])
    middle = (rectangle[:2] + rectangle[2:]) / 2
    maps[:, :, 2] = places - maps[:, :, :2] @ middle
    scenes.to_scene[:, row, layer] = maps
    scenes.image[:, row, layer] = covers.image[row]
    scenes.rectangle[row, layer] = rectangle
    scenes.opaque[row, layer] = covers.opaque[row]
    scenes.number[row, layer] = 0
    # It comes back where it went, from behind a cover that goes on.
    still = (clock >= gone)[:, None] * (middles[gone] - middles)
    scenes.to_scene[:, row, TARGET, :, 2] += still
    boxes += np.tile(still, 2)
    cover = np.concatenate([places - opaque / 2, places + opaque / 2], axis=1)
    away = (clock >= gone) & (clock <= returns)
    away |= _share_inside(boxes, cover) > 1 - LEAST_INSIDE
    scenes.shown[away, row, TARGET] = False
    boxes[away] = np.nan


def _share_inside(boxes_xyxy: Floats, others_xyxy: Floats) -> Floats:
    """`[T]`, share of each box `[T, 4]` that is inside the other."""
    low = np.maximum(boxes_xyxy[:, :2], others_xyxy[:, :2])
    high = np.minimum(boxes_xyxy[:, 2:], others_xyxy[:, 2:])
    inside: Floats = np.prod(np.maximum(high - low, 0.0), axis=1)
    return inside / np.prod(boxes_xyxy[:, 2:] - boxes_xyxy[:, :2], axis=1)
