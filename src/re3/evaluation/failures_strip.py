"""The moment of a loss in pictures: a few frames around it, with both boxes drawn in."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence
from re3.evaluation.failures import LOSS_OVERLAP
from re3.video.draw import RIM_COLOUR, Colour

STRIP_FRAMES = 5
STRIP_SPAN = 10
"""Frames from the loss to either end of the strip."""
PICTURE_WIDTH = 248
JPEG_QUALITY = 72
ZOOM_ROOM = 2.5
"""A strip shows this many times the extent of the boxes in it, where the frame is larger."""
TRUTH_COLOUR: Colour = (60, 210, 40)
TRACKER_COLOUR: Colour = (40, 40, 235)
"""BGR, green and red as in Fig. 7 of the paper."""

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Picture:
    """A frame of a strip: its index in the track and a JPEG as a `data:` address."""

    frame: int
    address: str


@dataclass(frozen=True)
class Strip:
    """The pictures of a loss and the size of the whole frames, width and height in pixels."""

    pictures: tuple[Picture, ...]
    frame_size: tuple[int, int]


def strip_frames(start: int, length: int) -> list[int]:
    """Indices of `STRIP_FRAMES` frames around frame `start` of a track of that length.

    Two from before and two from after it where there are as many, evenly over `STRIP_SPAN`; near
    an end of the track more from the other side.
    """
    low, high = max(start - STRIP_SPAN, 0), min(start + STRIP_SPAN, length - 1)
    half = STRIP_FRAMES // 2
    after = min(max(half, STRIP_FRAMES - 1 - (start - low)), high - start)
    before = min(STRIP_FRAMES - 1 - after, start - low)
    frames = {start}
    frames |= {round(frame) for frame in np.linspace(low, start, before + 1)} if before else set()
    frames |= {round(frame) for frame in np.linspace(start, high, after + 1)} if after else set()
    return sorted(frames)


def read_frames(sequence: Sequence, wanted: list[int]) -> dict[int, Image]:
    """Some frames of a track by their index; stops to read after the last of them.

    Raises:
        ValueError, OSError: the source cannot be read.
    """
    found = {}
    for index, image in enumerate(sequence.frames()):
        if index in wanted:
            found[index] = image
        if index >= max(wanted):
            break
    return found


def make_strip(sequence: Sequence, predicted_xywh: NDArray[np.float64], start: int) -> Strip:
    """The pictures of a loss, the truth in green and the tracker's box in red.

    Args:
        sequence: whose frames are read again.
        predicted_xywh: `[T, 4]`, NaN where there is no box.
        start: the first frame of the loss.

    Raises:
        ValueError, OSError: the source cannot be read.
    """
    wanted = strip_frames(start, len(sequence))
    images = read_frames(sequence, wanted)
    boxes = np.concatenate([sequence.boxes_xywh[wanted], predicted_xywh[wanted]])
    height, width = images[wanted[0]].shape[:2]
    view = view_of(boxes, width, height)
    pictures = []
    for frame in wanted:
        shown = [
            (sequence.boxes_xywh[frame], TRUTH_COLOUR),
            (predicted_xywh[frame], TRACKER_COLOUR),
        ]
        picture = cut(images[frame], view, PICTURE_WIDTH, shown)
        pictures.append(Picture(frame, jpeg_address(picture)))
    return Strip(tuple(pictures), (width, height))


def view_of(boxes_xywh: NDArray[np.float64], width: int, height: int) -> tuple[int, int, int, int]:
    """The part of a frame to show: left, top, right, bottom in pixels.

    About the middle of the boxes, `ZOOM_ROOM` times their extent, of the frame's own shape and
    inside it.

    Args:
        boxes_xywh: `[N, 4]`; rows of NaN are passed over.
    """
    known = boxes_xywh[np.isfinite(boxes_xywh).all(axis=1)]
    if not len(known):
        return 0, 0, width, height
    limits = np.array([width, height], dtype=np.float64)
    low = np.clip(known[:, :2].min(axis=0), 0, limits)
    high = np.clip((known[:, :2] + known[:, 2:]).max(axis=0), 0, limits)
    # Never so small that the picture would be blown up more than twice.
    smallest = PICTURE_WIDTH / 2 / width
    share = min(1.0, max(smallest, ZOOM_ROOM * float(((high - low) / limits).max())))
    size = np.round(limits * share)
    corner = np.round(np.clip((low + high) / 2 - size / 2, 0, limits - size))
    left, top = (int(value) for value in corner)
    right, bottom = (int(value) for value in corner + size)
    return left, top, right, bottom


def cut(
    image: Image,
    view: tuple[int, int, int, int],
    width: int,
    boxes: list[tuple[NDArray[np.float64], Colour]],
) -> Image:
    """A part of a frame at a given width, with boxes_xywh `[4]` of the frame drawn in."""
    left, top, right, bottom = view
    scale = width / max(right - left, 1)
    height = max(1, round((bottom - top) * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = cv2.resize(image[top:bottom, left:right], (width, height), interpolation=method)
    for box, colour in boxes:
        if np.isfinite(box).all():
            x, y, w, h = np.clip((np.asarray(box) - (left, top, 0, 0)) * scale, -9999, 9999)
            corner, opposite = (round(x), round(y)), (round(x + w), round(y + h))
            # A dark rim keeps the box visible on ground of its own colour.
            cv2.rectangle(picture, corner, opposite, RIM_COLOUR, 3, cv2.LINE_AA)
            cv2.rectangle(picture, corner, opposite, colour, 2, cv2.LINE_AA)
    return picture


def jpeg_address(picture: Image) -> str:
    """A picture as a `data:` address."""
    written, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not written:
        raise ValueError(f"OpenCV cannot write an image of shape {picture.shape} as JPEG")
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def overlap_svg(overlaps: NDArray[np.float64], marks: list[tuple[int, int]]) -> str:
    """The overlap over time as a small `<svg>`.

    Args:
        overlaps: `[T]`, NaN where there is no truth; the curve has gaps there.
        marks: first frame and one past the last of what is shaded, the losses.
    """
    width, height = 320.0, 64.0
    count = max(len(overlaps) - 1, 1)

    def x(frame: float) -> float:
        return 1 + (width - 2) * frame / count

    def y(value: float) -> float:
        return 2 + (height - 4) * (1 - value)

    parts = [
        f'<svg class="overlap" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" role="img" aria-label="overlap over time">',
        *(
            f'<rect x="{x(start):.1f}" y="0" width="{max(x(end) - x(start), 1):.1f}" '
            f'height="{height:g}" fill="#D55E00" fill-opacity="0.18"/>'
            for start, end in marks
        ),
        f'<line x1="0" x2="{width:g}" y1="{y(LOSS_OVERLAP):.1f}" y2="{y(LOSS_OVERLAP):.1f}" '
        'stroke="#888" stroke-dasharray="3 3" stroke-width="0.8"/>',
    ]
    known = np.flatnonzero(~np.isnan(overlaps))
    for run in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        points = " ".join(f"{x(t):.1f},{y(float(overlaps[t])):.1f}" for t in run)
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="#0072B2" stroke-width="1.4" '
            'stroke-linecap="round"/>'
        )
    return "".join(parts) + "</svg>"
