"""NanoTrack through ONNX Runtime, with post-processing of our own.

NanoTrack (github.com/HonglinChu/SiamTrackers) is a small Siamese tracker: a backbone sees a
template of the object once and a search crop in each frame, a head compares the two and gives, for
each cell of a grid, how likely it is the object's and how far the box reaches from there to the
left, top, right and bottom. OpenCV runs v1 and v2 itself; the head of v3 has a grid of 15 cells a
side where OpenCV insists on 16, so that version needs this module.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

TEMPLATE_SIZE = 127
SEARCH_SIZE = 255
STRIDE = 16
"""Pixels of the search crop from one cell of the head's grid to the next."""
CONTEXT = 0.5
"""The crops take in this share of (width + height) around the box."""
SMALLEST_SIDE = 10.0
"""Boxes never get narrower or lower than this many pixels."""


@dataclass(frozen=True)
class NanoTrackSettings:
    """What the authors tuned for each version.

    Attributes:
        window_influence: weight of the cosine window against the score, 0..1.
        penalty: how strongly a change of size or shape is held against a cell.
        size_rate: how fast the size follows the prediction, times score and penalty.
    """

    window_influence: float
    penalty: float
    size_rate: float


V1 = NanoTrackSettings(window_influence=0.462, penalty=0.148, size_rate=0.390)
V2 = NanoTrackSettings(window_influence=0.490, penalty=0.150, size_rate=0.385)
V3 = NanoTrackSettings(window_influence=0.455, penalty=0.138, size_rate=0.348)


class NanoTrack:
    """One object followed by NanoTrack; see `re3.evaluation.peers.SequenceTracker`.

    Args:
        backbone, head: the two ONNX files.
        settings: of the same version as the files.
    """

    def __init__(self, backbone: Path, head: Path, settings: NanoTrackSettings = V3) -> None:
        providers = ["CPUExecutionProvider"]
        self._backbone_file = backbone
        self._backbone = onnxruntime.InferenceSession(str(backbone), providers=providers)
        self._head = onnxruntime.InferenceSession(str(head), providers=providers)
        self._settings = settings
        cells = self._head.get_outputs()[0].shape[-1]
        # Cell centres as offsets from the middle of the search crop; an even grid has its middle
        # at cell cells // 2.
        self._offsets = (np.arange(cells) - cells // 2) * float(STRIDE)
        self._window = np.outer(np.hanning(cells), np.hanning(cells))

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Take the template from the box in this frame."""
        box = np.asarray(box_xywh, dtype=np.float64)
        self._size = box[2:].copy()
        self._centre = box[:2] + self._size / 2
        self._fill = frame.mean(axis=(0, 1))
        template = self._crop(frame, crop_side(self._size), TEMPLATE_SIZE)
        # The file fixes the input at 255 pixels and ONNX Runtime takes no other size; OpenCV's
        # engine reshapes the same network, and the template is needed only once.
        network = cv2.dnn.readNetFromONNX(str(self._backbone_file))
        network.setInput(template)
        self._template = network.forward()

    def update(self, frame: NDArray[np.uint8]) -> tuple[Floats, float]:
        """The box_xywh `[4]` in the next frame and the score of its cell, 0..1."""
        side = crop_side(self._size)
        scale = TEMPLATE_SIZE / side
        crop = self._crop(frame, side * SEARCH_SIZE / TEMPLATE_SIZE, SEARCH_SIZE)
        (features,) = self._backbone.run(None, {"input": crop})
        logits, distances = self._head.run(None, {"input1": self._template, "input2": features})
        scores = foreground(logits[0])
        boxes = boxes_of(distances[0], self._offsets)
        penalty = size_penalty(boxes[..., 2:], self._size * scale, self._settings.penalty)
        influence = self._settings.window_influence
        blended = scores * penalty * (1 - influence) + self._window * influence
        best = np.unravel_index(np.argmax(blended), blended.shape)
        self._move(boxes[best] / scale, float(penalty[best] * scores[best]), frame.shape)
        box = np.concatenate([self._centre - self._size / 2, self._size])
        return box, float(scores[best])

    def _move(self, found: Floats, trust: float, shape: tuple[int, ...]) -> None:
        """Take over a found box, given as offset of the centre and size in pixels of the frame."""
        limit = np.array([shape[1], shape[0]], dtype=np.float64)
        rate = trust * self._settings.size_rate
        self._centre = np.clip(self._centre + found[:2], 0.0, limit)
        size = self._size * (1 - rate) + found[2:] * rate
        self._size = np.clip(size, SMALLEST_SIDE, np.maximum(limit, SMALLEST_SIDE))

    def _crop(self, frame: NDArray[np.uint8], side: float, size: int) -> NDArray[np.float32]:
        """A square around the centre as float32 `[1, 3, size, size]`, BGR 0..255."""
        # Two pixels, so that a centre on the frame's edge still has one of them inside.
        pixels = max(round(side), 2)
        left, top = (int(value) for value in np.round(self._centre - pixels / 2))
        height, width = frame.shape[:2]
        x0, y0 = max(left, 0), max(top, 0)
        x1, y1 = min(left + pixels, width), min(top + pixels, height)
        # What lies outside has the mean colour of the first frame.
        patch = cv2.copyMakeBorder(
            frame[y0:y1, x0:x1],
            y0 - top,
            top + pixels - y1,
            x0 - left,
            left + pixels - x1,
            cv2.BORDER_CONSTANT,
            value=self._fill.tolist(),
        )
        square = cv2.resize(patch, (size, size), interpolation=cv2.INTER_LINEAR)
        return np.ascontiguousarray(square.transpose(2, 0, 1)[None], dtype=np.float32)


def crop_side(size: Floats) -> float:
    """Side of the template's square in pixels for a box of `size` (width, height)."""
    return float(np.sqrt(np.prod(size + CONTEXT * size.sum())))


def foreground(logits: NDArray[np.float32]) -> Floats:
    """Probability of the object `[S, S]` from two-class scores `[2, S, S]`, background first."""
    difference = np.asarray(logits[0], dtype=np.float64) - logits[1]
    return 1.0 / (1.0 + np.exp(np.clip(difference, -500.0, 500.0)))


def boxes_of(distances: NDArray[np.float32], offsets: Floats) -> Floats:
    """Boxes `[S, S, 4]` from distances `[4, S, S]` to left, top, right, bottom of each cell.

    They are cx, cy, width, height in pixels of the search crop, origin at its middle.
    """
    left, top, right, bottom = np.asarray(distances, dtype=np.float64)
    x, y = np.meshgrid(offsets, offsets)
    return np.stack(
        [x + (right - left) / 2, y + (bottom - top) / 2, left + right, top + bottom], axis=-1
    )


def size_penalty(sizes: Floats, size: Floats, strength: float) -> Floats:
    """Factor 0..1 `[S, S]` for sizes `[S, S, 2]` against the last `size` `[2]`, 1 for no change."""
    sizes = np.maximum(sizes, 1e-6)
    area = _ratio(_padded(sizes), _padded(size))
    shape = _ratio(sizes[..., 0] / sizes[..., 1], size[0] / size[1])
    return np.exp(-(area * shape - 1.0) * strength)


def _padded(sizes: Floats) -> Floats:
    # The side of the crop such a box would get: sqrt((w + p)(h + p)) with p = (w + h) / 2.
    return np.sqrt(np.prod(sizes + CONTEXT * sizes.sum(axis=-1, keepdims=True), axis=-1))


def _ratio(a: Floats, b: Floats | float) -> Floats:
    quotient = a / b
    return np.maximum(quotient, 1.0 / quotient)
