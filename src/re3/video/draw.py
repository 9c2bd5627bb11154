"""Boxes and labels drawn into a frame, legible at any size."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.result import Result, Status

Colour = tuple[int, int, int]
Point = tuple[int, int]
Rectangle = tuple[int, int, int, int]
"""Left, top, width, height in pixels."""

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
RIM_COLOUR: Colour = (0, 0, 0)
TEXT_COLOUR: Colour = (20, 20, 20)
FONT = cv2.FONT_HERSHEY_SIMPLEX
ASCII_ONLY = int(cv2.__version__.split(".")[0]) < 5
"""OpenCV 4 has a stroke font without umlauts and the like, OpenCV 5 a proper one."""


def draw_results(
    image: NDArray[np.uint8],
    results: Iterable[Result],
    colours: Mapping[int, Colour] | None = None,
) -> NDArray[np.uint8]:
    """A copy of the frame with the objects drawn in.

    A tracked object has a solid box in its colour, an uncertain one a thinner dashed box, a lost
    one a dashed grey box crossed out and labelled LOST. Labels lie above all boxes, each where it
    covers none of those before it: above its box, or else below, inside, beside or further off.

    Args:
        image: uint8 `[H, W, 3]` BGR; left as it is.
        results: of this frame.
        colours: BGR by object id; of those left out `colour_of` the id.
    """
    canvas = image.copy()
    shown = [(result, _colour(result, colours or {})) for result in results]
    for result, colour in shown:
        _draw_box(canvas, result, colour)
    taken: list[Rectangle] = []
    for result, colour in shown:
        taken.append(_draw_label(canvas, result, colour, taken))
    return canvas


def colour_of(object_id: int) -> Colour:
    """The object's colour, BGR."""
    return PALETTE[(object_id - 1) % len(PALETTE)] if object_id > 0 else PALETTE[0]


def _colour(result: Result, colours: Mapping[int, Colour]) -> Colour:
    if result.status is Status.LOST:
        return LOST_COLOUR
    return colours.get(result.object_id, colour_of(result.object_id))


def _corners(canvas: NDArray[np.uint8], result: Result) -> tuple[int, int, int, int]:
    """Left, top, right, bottom: the outermost pixels that belong to the box."""
    height, width = canvas.shape[:2]
    x, y, w, h = result.box_xywh
    # Far outside the frame OpenCV's integers would overflow.
    left, right = (int(np.clip(round(v), -4 * width, 4 * width)) for v in (x, x + w))
    top, bottom = (int(np.clip(round(v), -4 * height, 4 * height)) for v in (y, y + h))
    return left, top, max(left, right - 1), max(top, bottom - 1)


def _draw_box(canvas: NDArray[np.uint8], result: Result, colour: Colour) -> None:
    thickness = max(1, round(min(canvas.shape[:2]) / 240))
    left, top, right, bottom = _corners(canvas, result)
    if result.status is Status.TRACKED:
        # A dark rim keeps the box visible on a background of its own colour. On small frames it
        # would outweigh the line itself.
        if thickness > 1:
            cv2.rectangle(canvas, (left, top), (right, bottom), RIM_COLOUR, thickness + 2)
        cv2.rectangle(canvas, (left, top), (right, bottom), colour, thickness)
        return
    thin = max(1, round(thickness * 0.75))
    dash = 4 * thickness
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    lines = list(zip(corners, corners[1:] + corners[:1], strict=True))
    for start, end in lines:
        # Dark between the dashes: seen on light ground and on dark.
        cv2.line(canvas, start, end, RIM_COLOUR, thin)
        _dashes(canvas, start, end, colour, thin, dash)
    if result.status is Status.LOST:
        cv2.line(canvas, (left, top), (right, bottom), colour, thin, cv2.LINE_AA)
        cv2.line(canvas, (left, bottom), (right, top), colour, thin, cv2.LINE_AA)


def _dashes(
    canvas: NDArray[np.uint8], start: Point, end: Point, colour: Colour, thickness: int, dash: int
) -> None:
    length = math.dist(start, end)
    a, b = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    for at in np.arange(0, length, 2 * dash):
        p, q = (a + (b - a) * min(t, length) / length for t in (at, at + dash))
        points = [(round(float(point[0])), round(float(point[1]))) for point in (p, q)]
        cv2.line(canvas, points[0], points[1], colour, thickness)


def _text(result: Result) -> str:
    shown = "" if math.isnan(result.score) else f" {result.score:.2f}"
    text = f"{result.label}{shown}"
    if result.status is Status.LOST:
        text += " LOST"
    return text.encode("ascii", "replace").decode() if ASCII_ONLY else text


def _draw_label(
    canvas: NDArray[np.uint8], result: Result, colour: Colour, taken: list[Rectangle]
) -> Rectangle:
    """Dark text on a plate of the object's colour, inside the image and beside other plates.

    Args:
        canvas: to draw into.
        result, colour: of the object.
        taken: places of the plates that are there.

    Returns:
        the place of the plate.
    """
    height, width = canvas.shape[:2]
    text = _text(result)
    scale = max(0.38, min(height, width) / 900)
    pen = max(1, round(scale * 1.6))
    (text_width, text_height), baseline = cv2.getTextSize(text, FONT, scale, pen)
    if text_width > width - 4:  # a long name on a small frame
        scale *= max(0.5, (width - 4) / text_width)
        (text_width, text_height), baseline = cv2.getTextSize(text, FONT, scale, pen)
    pad = max(2, text_height // 4)
    plate_width, plate_height = text_width + 2 * pad, text_height + baseline + 2 * pad
    place = _place_of(_corners(canvas, result), (plate_width, plate_height), (width, height), taken)
    x, y = place[:2]
    plate = canvas[y : y + plate_height, x : x + plate_width]
    plate[:] = colour
    origin = (x + pad, y + pad + text_height)
    cv2.putText(canvas, text, origin, FONT, scale, TEXT_COLOUR, pen, cv2.LINE_AA)
    return place


def _place_of(
    box: tuple[int, int, int, int],
    plate: tuple[int, int],
    frame: tuple[int, int],
    taken: list[Rectangle],
) -> Rectangle:
    """Where a plate goes: the first place about its box that is free, or the freest of them.

    Args:
        box: left, top, right, bottom of its object.
        plate: its width and height.
        frame: width and height of the image, which the place lies in.
        taken: places of other plates.
    """
    (left, top, right, bottom), (width, height) = box, plate
    above, below = top - height, bottom + 1
    tried = [(left, above if above >= 0 else below)]
    tried += [(left, below), (left, top), (right - width + 1, above), (right - width + 1, below)]
    tried += [(right + 1, top), (left - width, top)]
    # Then row by row away from the box.
    for row in range(1, len(taken) + 1):
        tried += [(left, above - row * height), (left, below + row * height)]
    found: list[tuple[int, Rectangle]] = []
    for x, y in tried:
        place = (
            int(np.clip(x, 0, max(frame[0] - width, 0))),
            int(np.clip(y, 0, max(frame[1] - height, 0))),
            width,
            height,
        )
        covered = sum(_common(place, other) for other in taken)
        if not covered:
            return place
        found.append((covered, place))
    return min(found)[1]


def _common(a: Rectangle, b: Rectangle) -> int:
    """Pixels that two rectangles have in common."""
    across = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    down = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    return max(across, 0) * max(down, 0)
