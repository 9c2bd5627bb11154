"""Regions of a video that may show an object: moving ones, or salient ones if nothing moves."""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

THUMBNAIL = 160
"""Longer side in pixels of the images on which motion is measured."""
BACKGROUND_FRAMES = 21
"""Frames whose median is the background."""
DIFFERENCE = 16.0
"""Grey levels from the background, of 255, from which a pixel is foreground."""
MOST_FOREGROUND = 0.25
"""Median share of foreground above which the camera counts as moving."""
FLOW_STEP = 3
"""Frames between the two of which optical flow is computed."""
LEAST_FLOW = 0.8
"""Pixels of the thumbnail that a region moves relative to the camera in `FLOW_STEP` frames."""
SALIENT_SIZE = (128, 96)
AREA = (0.003, 0.45)
"""Smallest part of the frame that a region covers, and largest part that its box does."""
LEAST_FILLED = 0.3
"""Part of its box that a region covers at least."""
LONGEST = 5.0
"""Largest ratio of a box's sides."""


# Without eq=False the generated __eq__ would compare arrays and fail on their truth value.
@dataclass(frozen=True, eq=False)
class Region:
    """A box in one frame that a track may start from.

    Attributes:
        frame: index of the frame.
        box_xywh: `[4]`, pixels of the frame.
        strength: larger is more promising; comparable within one call only.
    """

    frame: int
    box_xywh: Floats
    strength: float


class Motion:
    """What moves in a stretch of video.

    Args:
        frames: uint8 `[H, W, 3]` BGR, of one size, without a cut.

    Attributes:
        scale: thumbnail pixels per pixel of the frame.
        foreground: bool `[T, h, w]`, pixels of thumbnails that differ from the median frame; None
            where the camera moves.
    """

    def __init__(self, frames: Several[NDArray[np.uint8]]) -> None:
        height, width = frames[0].shape[:2]
        self.scale = min(1.0, THUMBNAIL / max(height, width))
        size = (max(1, round(width * self.scale)), max(1, round(height * self.scale)))
        self._grey = np.stack(
            [
                cv2.resize(cv2.cvtColor(f, cv2.COLOR_BGR2GRAY), size, interpolation=cv2.INTER_AREA)
                for f in frames
            ]
        )
        self.foreground = _foreground(self._grey)

    def regions(self, frame: int) -> list[Region]:
        """Moving regions of a frame, strongest first."""
        if self.foreground is not None:
            mask, strength = self.foreground[frame], np.ones(self._grey.shape[1:])
        else:
            # The last frames have none after them.
            first = max(0, min(frame, len(self._grey) - 1 - FLOW_STEP))
            last = min(first + FLOW_STEP, len(self._grey) - 1)
            strength = relative_motion(self._grey[first], self._grey[last])
            mask = strength > max(LEAST_FLOW, 2.5 * float(np.median(strength)) + 0.3)
            opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3)))
            mask = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((7, 7))) > 0
        return [
            Region(frame, box / self.scale, weight) for box, weight in boxes_of_mask(mask, strength)
        ]

    def own(self, boxes_xywh: Floats) -> float:
        """Mean motion of boxes relative to the camera, thumbnail pixels in `FLOW_STEP` frames.

        Args:
            boxes_xywh: `[T, 4]`, pixels of the frames, NaN in frames without a box.
        """
        motions = []
        for index in range(0, len(boxes_xywh) - FLOW_STEP, FLOW_STEP):
            if np.isfinite(boxes_xywh[index]).all():
                motion = relative_motion(self._grey[index], self._grey[index + FLOW_STEP])
                inside = motion[self._inside(boxes_xywh[index])]
                motions.append(float(np.median(inside)) if inside.size else 0.0)
        return float(np.mean(motions)) if motions else 0.0

    def foreground_share(self, frame: int, box_xywh: Floats) -> float:
        """Part 0..1 of a box that is foreground; 1 where the camera moves."""
        if self.foreground is None:
            return 1.0
        inside = self.foreground[frame][self._inside(box_xywh)]
        return float(inside.mean()) if inside.size else 0.0

    def _inside(self, box_xywh: Floats) -> tuple[slice, slice]:
        """The pixels of a thumbnail that a box covers."""
        low = np.maximum(box_xywh[:2] * self.scale, 0).astype(int)
        high = np.maximum((box_xywh[:2] + box_xywh[2:]) * self.scale, -1).astype(int) + 1
        return slice(low[1], high[1]), slice(low[0], high[0])


def salient_regions(frame: NDArray[np.uint8], index: int) -> list[Region]:
    """Salient regions of one frame that do not touch its edge, strongest first.

    Spectral residual (Hou and Zhang, CVPR 2007).

    Args:
        frame: uint8 `[H, W, 3]` BGR.
        index: what the regions are to have as their frame.
    """
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    small = cv2.resize(grey, SALIENT_SIZE, interpolation=cv2.INTER_AREA).astype(np.float64)
    spectrum = np.fft.fft2(small)
    amplitude = np.log(np.abs(spectrum) + 1e-9)
    residual = amplitude - cv2.blur(amplitude, (3, 3), borderType=cv2.BORDER_REFLECT)
    saliency = np.abs(np.fft.ifft2(np.exp(residual + 1j * np.angle(spectrum)))) ** 2
    smooth = cv2.GaussianBlur(saliency, (0, 0), 3)
    mask = smooth > smooth.mean() + 2 * smooth.std()
    scale = np.array(SALIENT_SIZE * 2) / (frame.shape[1::-1] * 2)
    low, high = np.ones(2), np.array(SALIENT_SIZE) - 1
    return [
        Region(index, box / scale, weight)
        for box, weight in boxes_of_mask(mask, smooth)
        if (box[:2] >= low).all() and (box[:2] + box[2:] <= high).all()
    ]


def boxes_of_mask(mask: NDArray[np.bool_], strength: Floats) -> list[tuple[Floats, float]]:
    """Boxes_xywh `[4]` of a mask's connected parts that may be objects, strongest first.

    Args:
        mask, strength: `[h, w]`; a part is as strong as its mean strength times the root of its
            area.
    """
    count, labels, parts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    found = []
    for label in range(1, count):
        x, y, width, height, area = (int(value) for value in parts[label])
        box_area = width * height
        if area < AREA[0] * mask.size or box_area > AREA[1] * mask.size:
            continue
        sides = max(width, height) / min(width, height)
        if area < LEAST_FILLED * box_area or sides > LONGEST:
            continue
        weight = float(strength[labels == label].mean()) * area**0.5
        found.append((np.array([x, y, width, height], dtype=np.float64), weight))
    return sorted(found, key=lambda part: -part[1])


def relative_motion(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> Floats:
    """How far each pixel moves `[h, w]` in pixels, less the motion of the camera.

    Args:
        first, second: grey images, uint8 `[h, w]`.
    """
    flow = _optical_flow(first, second)
    height, width = first.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    points = np.stack([x, y], axis=-1)[4:-4:8, 4:-4:8].reshape(-1, 2).astype(np.float32)
    moved = points + flow[4:-4:8, 4:-4:8].reshape(-1, 2)
    camera, _ = (
        cv2.estimateAffine2D(points, moved, method=cv2.RANSAC, ransacReprojThreshold=0.7)
        if len(points) >= 3  # an affine map has six numbers
        else (None, None)
    )
    if camera is None:
        camera = np.eye(2, 3)
    by_camera = np.stack([x, y, np.ones_like(x)], axis=-1) @ camera.T - np.stack([x, y], axis=-1)
    return np.linalg.norm(flow - by_camera, axis=-1)


def _optical_flow(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.float32]:
    method = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    return np.asarray(method.calc(first, second, None), dtype=np.float32)


def _foreground(grey: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    """Bool `[T, h, w]` from uint8 `[T, h, w]`; None where the camera moves."""
    chosen = grey[:: max(1, len(grey) // BACKGROUND_FRAMES)]
    background = np.median(chosen, axis=0)
    masks = []
    for image in grey:
        difference = cv2.GaussianBlur(np.abs(image - background), (0, 0), 1)
        mask = (difference > DIFFERENCE).astype(np.uint8)
        opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2)))
        masks.append(cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((5, 5))) > 0)
    found = np.stack(masks)
    return None if np.median(found.mean(axis=(1, 2))) > MOST_FOREGROUND else found
