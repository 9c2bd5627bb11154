"""FEAR-XS through ONNX Runtime, with post-processing of our own.

FEAR-XS (Borsuk et al., "FEAR: Fast, Efficient, Accurate and Robust Visual Tracker", ECCV 2022) is a
Siamese tracker of half a GMAC. One network computes features of a template of the object once, the
other compares them with a search crop in each frame and gives, for each cell of a grid, a score and
the distances from there to the box's left, top, right and bottom. Crops do not keep the aspect: the
box fills the same part of them whatever its shape.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import onnxruntime
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

TEMPLATE_SIZE = 128
SEARCH_SIZE = 256
TEMPLATE_CONTEXT = 0.2
"""The template reaches this share of the box's width and height beyond it on each side."""
SEARCH_CONTEXT = 2.0
"""The same of the search crop."""
LAST_SIDE = SEARCH_SIZE / (1 + 2 * SEARCH_CONTEXT)
"""Pixels of the search crop that the last box is wide and high."""
CELLS = 16
"""Cells of the grid on each side."""
STRIDE = 16
"""Pixels of the search crop from one cell to the next."""
PENALTY = 0.062
"""How strongly a change of size or shape is held against a cell (the authors' `penalty_k`)."""
WINDOW_INFLUENCE = 0.38
"""Weight of the cosine window against the score, 0..1."""
SIZE_RATE = 0.765
"""How fast the size follows the prediction, times score and penalty, squared."""
SMALLEST_SIDE = 3.0
"""Boxes never get narrower or lower than this many pixels."""


class FearXs:
    """One object followed by FEAR-XS; see `re3.evaluation.peers.SequenceTracker`.

    Args:
        template, search: the two ONNX files.
    """

    def __init__(self, template: Path, search: Path) -> None:
        self._template_network = _session(template)
        self._search_network = _session(search)
        self._window = np.outer(np.hanning(CELLS), np.hanning(CELLS))

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Take the template from the box in this frame."""
        x, y, width, height = np.asarray(box_xywh, dtype=np.float64)
        self._box_xyxy = np.array([x, y, x + width, y + height])
        self._fill = frame.mean(axis=(0, 1))
        region = expanded(self._box_xyxy, TEMPLATE_CONTEXT)
        image = cut(frame, region, TEMPLATE_SIZE, self._fill)
        (self._template,) = self._template_network.run(None, {"image": image})

    def update(self, frame: NDArray[np.uint8]) -> tuple[Floats, float]:
        """The box_xywh `[4]` in the next frame and the score of its cell, 0..1."""
        region = expanded(self._box_xyxy, SEARCH_CONTEXT)
        image = cut(frame, region, SEARCH_SIZE, self._fill)
        distances, logits = self._search_network.run(
            ["bbox", "cls"], {"image": image, "template_features": self._template}
        )
        scores = 1.0 / (1.0 + np.exp(-np.asarray(logits[0, 0], dtype=np.float64)))
        boxes = boxes_of(distances[0])
        penalty = size_penalty(boxes[..., 2:] - boxes[..., :2])
        blended = penalty * scores * (1 - WINDOW_INFLUENCE) + self._window * WINDOW_INFLUENCE
        best = np.unravel_index(np.argmax(blended), blended.shape)
        rate = float(penalty[best] * scores[best] * SIZE_RATE) ** 2
        self._move(boxes[best], region, rate, frame.shape)
        low, high = self._box_xyxy[:2], self._box_xyxy[2:]
        return np.concatenate([low, high - low]), float(scores[best])

    def _move(
        self, found_xyxy: Floats, region_xyxy: Floats, rate: float, shape: tuple[int, ...]
    ) -> None:
        """Take over a found box, in pixels of the search crop: its centre, and its size in part."""
        scale = (region_xyxy[2:] - region_xyxy[:2]) / SEARCH_SIZE
        centre = region_xyxy[:2] + scale * (found_xyxy[:2] + found_xyxy[2:]) / 2
        old, new = self._box_xyxy[2:] - self._box_xyxy[:2], found_xyxy[2:] - found_xyxy[:2]
        size = (1 - rate) * old + rate * scale * new
        self._box_xyxy = inside_frame(centre, size, shape)


def expanded(box_xyxy: Floats, context: float) -> Floats:
    """The region `[4]` that reaches `context` times the box's sides beyond it on each side."""
    margin = context * (box_xyxy[2:] - box_xyxy[:2])
    return np.concatenate([box_xyxy[:2] - margin, box_xyxy[2:] + margin])


def cut(
    frame: NDArray[np.uint8], region_xyxy: Floats, side: int, fill: Floats
) -> NDArray[np.float32]:
    """A region of a BGR frame as RGB 0..255, float32 `[1, 3, side, side]`.

    Args:
        frame: uint8 `[H, W, 3]` BGR.
        region_xyxy: stretched to the square, in pixels of the frame.
        side: of the square.
        fill: BGR colour of what lies outside the frame.
    """
    step = (region_xyxy[2:] - region_xyxy[:2]) / side
    # Pixel i of the crop has its centre at i + 0.5, as has each of the frame.
    offset = region_xyxy[:2] + step / 2 - 0.5
    matrix = np.array([[step[0], 0.0, offset[0]], [0.0, step[1], offset[1]]])
    crop = cv2.warpAffine(
        frame,
        matrix,
        (side, side),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=fill.tolist(),
    )
    return np.ascontiguousarray(crop[..., ::-1].transpose(2, 0, 1)[None], dtype=np.float32)


def boxes_of(distances: NDArray[np.float32]) -> Floats:
    """Boxes `[S, S, 4]`, xyxy in pixels of the search crop, from `[4, S, S]` distances to the left,
    top, right and bottom of each cell's point."""
    points = STRIDE * (np.arange(CELLS) - CELLS // 2) + SEARCH_SIZE / 2
    x, y = np.meshgrid(points, points)
    left, top, right, bottom = np.asarray(distances, dtype=np.float64)
    return np.stack([x - left, y - top, x + right, y + bottom], axis=-1)


def size_penalty(sizes: Floats) -> Floats:
    """Factor 0..1 `[S, S]` for sizes `[S, S, 2]` in pixels of the search crop, 1 for no change.

    The last box is a square of `LAST_SIDE` pixels there, whatever its shape in the frame.
    """
    sizes = np.maximum(sizes, 1e-6)
    area = _change(_padded(sizes) / _padded(np.full(2, LAST_SIDE)))
    shape = _change(sizes[..., 0] / sizes[..., 1])
    return np.exp(-(area * shape - 1.0) * PENALTY)


def inside_frame(centre: Floats, size: Floats, shape: tuple[int, ...]) -> Floats:
    """A box_xyxy `[4]` cut at the frame's edges, `SMALLEST_SIDE` or more wide and high.

    Args:
        centre, size: of the box, `[2]` each, in pixels.
        shape: of the frame, height first.
    """
    limit = np.array([shape[1], shape[0]], dtype=np.float64)
    low = np.clip(centre - size / 2, 0.0, np.maximum(limit - SMALLEST_SIDE, 0.0))
    high = np.clip(centre + size / 2, 0.0, limit)
    return np.concatenate([low, np.maximum(high, low + SMALLEST_SIDE)])


def _session(file: Path) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    # Two threads that wait for each other are slower than one where other programs run.
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])


def _padded(sizes: Floats) -> Floats:
    # The side of a square with context: sqrt((w + p)(h + p)) with p = (w + h) / 2.
    padding = sizes.sum(axis=-1, keepdims=True) / 2
    return np.sqrt(np.prod(sizes + padding, axis=-1))


def _change(quotient: Floats) -> Floats:
    return np.maximum(quotient, 1.0 / quotient)
