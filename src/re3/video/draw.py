"""Boxes and labels drawn into a frame, legible at any size."""

from __future__ import annotations

import math
from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.result import Result, Status

Colour = tuple[int, int, int]

PALETTE: tuple[Colour, ...] = (
    (80, 200, 60),
    (60, 130, 255),
    (255, 170, 40),
    (70, 70, 235),
    (220, 90, 200),
    (30, 210, 240),
    (200, 200, 30),
    (150, 90, 255),
    (90, 220, 170),
    (255, 110, 110),
)
"""BGR colours by object, in turn; well apart, and bright enough for dark text upon them."""

LOST_COLOUR: Colour = (150, 150, 150)
FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_results(image: NDArray[np.uint8], results: Iterable[Result]) -> NDArray[np.uint8]:
    """A copy of the frame with the objects drawn in.

    A tracked object has a solid box in its colour, an uncertain one a dashed box, a lost one a
    dashed grey box crossed out and labelled LOST.

    Args:
        image: uint8 `[H, W, 3]` BGR; left as it is.
        results: of this frame.
    """
    canvas = image.copy()
    for result in results:
        _draw(canvas, result)
    return canvas


def colour_of(object_id: int) -> Colour:
    """The object's colour, BGR."""
    return PALETTE[(object_id - 1) % len(PALETTE)] if object_id > 0 else PALETTE[0]


def _draw(canvas: NDArray[np.uint8], result: Result) -> None:
    height, width = canvas.shape[:2]
    thickness = max(1, round(min(height, width) / 240))
    x, y, w, h = result.box_xywh
    # Far outside the frame OpenCV's integers would overflow.
    left, top = (int(np.clip(round(v), -4 * s, 4 * s)) for v, s in ((x, width), (y, height)))
    right, bottom = (
        int(np.clip(round(v), -4 * s, 4 * s)) for v, s in ((x + w, width), (y + h, height))
    )
    lost = result.status is Status.LOST
    colour = LOST_COLOUR if lost else colour_of(result.object_id)
    if result.status is Status.TRACKED:
        # A dark rim keeps the box visible on a background of its own colour.
        cv2.rectangle(canvas, (left, top), (right, bottom), (0, 0, 0), thickness + 2)
        cv2.rectangle(canvas, (left, top), (right, bottom), colour, thickness)
    else:
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            _dashed(canvas, start, end, colour, thickness)
    if lost:
        cv2.line(canvas, (left, top), (right, bottom), colour, thickness)
        cv2.line(canvas, (left, bottom), (right, top), colour, thickness)
    _label(canvas, _text(result), (left, top, bottom), colour)


def _text(result: Result) -> str:
    shown = "" if math.isnan(result.score) else f" {result.score:.2f}"
    text = f"{result.label}{shown}"
    return f"{text} LOST" if result.status is Status.LOST else text


def _dashed(
    canvas: NDArray[np.uint8],
    start: tuple[int, int],
    end: tuple[int, int],
    colour: Colour,
    thickness: int,
) -> None:
    length = math.dist(start, end)
    dash = 6 * thickness
    a, b = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    for at in np.arange(0, length, 2 * dash):
        p, q = (a + (b - a) * min(t, length) / length for t in (at, at + dash))
        points = [(round(float(point[0])), round(float(point[1]))) for point in (p, q)]
        cv2.line(canvas, points[0], points[1], (0, 0, 0), thickness + 2)
        cv2.line(canvas, points[0], points[1], colour, thickness)


def _label(canvas: NDArray[np.uint8], text: str, box: tuple[int, int, int], colour: Colour) -> None:
    """Dark text on a plate of the object's colour: above the box, inside the image."""
    height, width = canvas.shape[:2]
    text = text.encode("ascii", "replace").decode()  # OpenCV's font has nothing else
    scale = max(0.38, min(height, width) / 900)
    pen = max(1, round(scale * 1.6))
    (text_width, text_height), baseline = cv2.getTextSize(text, FONT, scale, pen)
    if text_width > width - 4:  # a long name on a small frame
        scale *= max(0.5, (width - 4) / text_width)
        (text_width, text_height), baseline = cv2.getTextSize(text, FONT, scale, pen)
    pad = max(2, text_height // 4)
    plate_width, plate_height = text_width + 2 * pad, text_height + baseline + 2 * pad
    left, top, bottom = box
    y = top - plate_height if top - plate_height >= 0 else min(bottom, height - plate_height)
    x = int(np.clip(left, 0, max(width - plate_width, 0)))
    y = int(np.clip(y, 0, max(height - plate_height, 0)))
    cv2.rectangle(canvas, (x, y), (x + plate_width, y + plate_height), colour, cv2.FILLED)
    origin = (x + pad, y + pad + text_height)
    cv2.putText(canvas, text, origin, FONT, scale, (20, 20, 20), pen, cv2.LINE_AA)
