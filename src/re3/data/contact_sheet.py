"""A sheet of training clips: what the network is shown, and what it is to answer."""

from __future__ import annotations

import math
from collections.abc import Sequence as Several

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.augment import AugmentedClip
from re3.geometry import REGRESSION_SCALE, encode, search_region

PRESENT = (0, 200, 0)
OCCLUDED = (0, 140, 255)
ABSENT = (40, 40, 230)
"""BGR colours of the target's box, and of the frame about a crop without one."""

HIDDEN = 0.5
"""From this share on, an object counts as occluded."""

_CAPTION = 20
_GAP = 2
_PAPER = 255


def contact_sheet(
    clips: Several[AugmentedClip], context: float = 3.0, size: int = 128
) -> NDArray[np.uint8]:
    """Rows of clips: the crops of consecutive frames, each cut at the true box of the frame before.

    The first is cut at its own box. The box drawn is the target, green, or orange where half of the
    object or more is hidden. A crop with a red border has no target: the object is absent, and the
    crop is cut at its last box, or the target is outside.

    Args:
        clips: drawn by a `ClipSampler`, of equal length.
        context: side of a crop in units of the box's side.
        size: of a crop on the sheet in pixels.

    Returns:
        uint8 `[H, W, 3]` BGR.

    Raises:
        ValueError: no clip, clips of several lengths, or what reading their frames raises.
    """
    lengths = {len(clip.boxes_xyxy) for clip in clips}
    if len(lengths) != 1:
        raise ValueError(
            f"{len(clips)} clips of {sorted(lengths)} frames; expected clips of one length"
        )
    return np.concatenate([_row(clip, context, size) for clip in clips])


def _row(clip: AugmentedClip, context: float, size: int) -> NDArray[np.uint8]:
    cells, last = [], clip.boxes_xyxy[0]
    for t, box in enumerate(clip.boxes_xyxy):
        if t == 1 and clip.leaps:  # long before or after the first: nothing tells where to look
            last = box
        region = search_region(last, context)
        cell = clip.crop(t, region, size).copy()
        corners = encode(box, region) / REGRESSION_SCALE * size
        centre = (corners[:2] + corners[2:]) / 2
        if np.isnan(box).any() or ((centre < 0) | (centre > size)).any():
            cv2.rectangle(cell, (0, 0), (size - 1, size - 1), ABSENT, 3)
        else:
            hidden = _is_hidden(clip, t)
            low, high = (tuple(map(int, np.round(c))) for c in (corners[:2], corners[2:] - 1))
            cv2.rectangle(cell, low, high, OCCLUDED if hidden else PRESENT, 1)
        cells.append(
            cv2.copyMakeBorder(cell, 0, _GAP, 0, _GAP, cv2.BORDER_CONSTANT, value=(_PAPER,) * 3)
        )
        last = last if np.isnan(box).any() else box
    crops = np.concatenate(cells, axis=1)
    return np.concatenate([_caption(clip, crops.shape[1]), crops])


def _is_hidden(clip: AugmentedClip, frame: int) -> bool:
    if clip.origin is not None and clip.origin.occluded is not None:
        return bool(clip.origin.occluded[frame])
    return bool(1.0 - clip.visible[frame] >= HIDDEN)


def caption(clip: AugmentedClip) -> str:
    """What a clip is: its source, its name, its frames and what was done to it."""
    origin = clip.origin
    if origin is None:
        return "unknown"
    words = [origin.source, origin.name]
    if origin.frames is None:
        words.append("simulated")
    else:
        first, last = int(origin.frames[0]), int(origin.frames[-1])
        steps = np.abs(np.diff(origin.frames))
        if clip.leaps:
            words.append(f"leaps {int(steps[0])}")
            steps = steps[1:]
        words.append(f"frames {first} to {last}")
        if len(steps) and steps.max() > 1:
            words.append(f"stride {int(steps.max())}")
    if origin.mirrored:
        words.append("mirrored")
    sizes = clip.boxes_xyxy[:, 2:] - clip.boxes_xyxy[:, :2]
    width, height = np.nanmedian(sizes, axis=0)
    words.append(f"{width:.0f} x {height:.0f} px")
    absent = int(np.isnan(clip.boxes_xyxy[:, 0]).sum())
    if absent:
        words.append(f"absent in {absent}")
    return ", ".join(words)


def _caption(clip: AugmentedClip, width: int) -> NDArray[np.uint8]:
    strip = np.full((_CAPTION, width, 3), _PAPER, dtype=np.uint8)
    # OpenCV's letters are ASCII alone.
    text = caption(clip).encode("ascii", "replace").decode()
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.42
    (wide, _), _ = cv2.getTextSize(text, font, scale, 1)
    if wide > width - 8:
        text = text[: max(math.floor(len(text) * (width - 8) / wide) - 3, 1)] + "..."
    cv2.putText(strip, text, (4, _CAPTION - 6), font, scale, (0, 0, 0), 1, cv2.LINE_AA)
    return strip
