"""What tracking looks like: frames with the truth and a tracker's box (Re3, Fig. 7)."""

from __future__ import annotations

import math
from collections.abc import Sequence as Items
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence
from re3.evaluation.one_pass import first_annotated
from re3.evaluation.peers import TrackerFactory
from re3.evaluation.plots_style import look, new_figure, plain, require
from re3.geometry import iou_xywh

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUTH = "#00C832"
TRACKER = "#F0141E"
"""Green and red, as in the paper."""
SHOWN_FRAME = 100
"""By default the frame shown beside the first, counted from 1 at the start of the track."""
PICTURE_WIDTH = 480
"""Pixels; wider frames are made smaller for the grid."""
CELL_WIDTH = 1.75
"""Inches of a picture in the grid."""
LINE = 1.1
"""Points of the widest line of a box."""
LINE_SHARE = 0.1
"""Of the shorter side of a box, which its line takes at most: small objects stay visible."""
FINEST = 0.2
"""Points of the finest line."""
_DASHES = (0, (3, 3))
"""Of the tracker's box, in widths of its line: the truth shows between them where both are one."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame with its boxes.

    Attributes:
        number: of the frame, counted from 1 at the start of the track.
        image: uint8 `[H, W, 3]` BGR.
        truth_xywh, tracker_xywh: `[4]` in pixels of the image; NaN where there is none.
    """

    number: int
    image: NDArray[np.uint8]
    truth_xywh: NDArray[np.float64]
    tracker_xywh: NDArray[np.float64]

    @property
    def overlap(self) -> float:
        """Of both boxes, 0..1: 0 without the tracker's, NaN without truth."""
        if np.isnan(self.truth_xywh).any():
            return math.nan
        return float(np.nan_to_num(iou_xywh(self.tracker_xywh, self.truth_xywh)))


@dataclass(frozen=True, eq=False)
class Example:
    """The frames shown of one sequence, in order."""

    name: str
    shots: tuple[Shot, ...]


def make_example(
    sequence: Sequence,
    factory: TrackerFactory,
    frame: int = SHOWN_FRAME,
) -> Example:
    """Track a sequence as far as it is shown.

    Args:
        sequence: with at least one annotated frame.
        factory: makes the tracker; it is started in the first annotated frame, frame 1.
        frame: the frame to show beside that; the last one of a shorter track.

    Raises:
        ValueError: `frame` is below 2, nothing is annotated, or the frames cannot be read.
        Whatever the tracker raises.
    """
    if frame < 2:
        raise ValueError(f"frame is {frame}; expected 2 (the one after the first) or more")
    start = first_annotated(sequence)
    end = min(start + frame, len(sequence))
    tracker = factory()
    shots = []
    for index, image in enumerate(islice(sequence.frames(), end)):
        truth = sequence.boxes_xywh[index]
        if index < start:
            continue
        if index == start:
            tracker.init(image, truth)
            box = truth
        else:
            given, _ = tracker.update(image)
            box = np.asarray(given, dtype=np.float64)
        if index in (start, end - 1):
            shots.append(_shot(index - start + 1, image, truth, box))
    return Example(sequence.name, tuple(shots))


def qualitative_plot(
    examples: Items[Example], columns: int = 3, tracker: str = "tracker"
) -> Figure:
    """The examples as a grid: the frames of each side by side, its name and overlap below.

    The truth is drawn as a green line, the tracker's box as red dashes above it; lines are the
    finer the smaller the object.

    Args:
        examples: each with one or two frames.
        columns: examples in a row.
        tracker: its name, for the legend.

    Raises:
        ImportError: the extra `report` is not installed.
        ValueError: no example, or no column.
    """
    if not examples or columns < 1:
        raise ValueError(
            f"{len(examples)} examples in {columns} columns; expected one or more of each"
        )
    across = min(columns, len(examples))
    down = math.ceil(len(examples) / across)
    shots = [shot for example in examples for shot in example.shots]
    shape = float(np.median([shot.image.shape[0] / shot.image.shape[1] for shot in shots]))
    with look():
        figure = new_figure(2 * CELL_WIDTH * across, (CELL_WIDTH * shape + 0.3) * down + 0.3)
        cells = figure.subplots(down, 2 * across, squeeze=False)
        for axes in cells.flat:
            axes.axis("off")
        for place, example in enumerate(examples):
            row, column = divmod(place, across)
            for axes, shot in zip(cells[row, 2 * column :], example.shots, strict=False):
                _draw(axes, example.name, shot)
        lines = require("matplotlib.lines")
        handles = [
            lines.Line2D([], [], color=colour, linewidth=2, linestyle=style)
            for colour, style in ((TRUTH, "-"), (TRACKER, _DASHES))
        ]
        figure.legend(
            handles, ["truth", plain(tracker)], loc="outside upper center", ncols=2, frameon=False
        )
    return figure


def _shot(
    number: int,
    image: NDArray[np.uint8],
    truth: NDArray[np.float64],
    box: NDArray[np.float64],
) -> Shot:
    scale = min(1.0, PICTURE_WIDTH / image.shape[1])
    if scale < 1.0:
        size = (PICTURE_WIDTH, max(1, round(image.shape[0] * scale)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return Shot(number, image, truth * scale, box * scale)


def _line_width(side: float, width: int) -> float:
    """Points of the line of a box.

    Args:
        side: the shorter side of the box in pixels of the picture.
        width: of the picture in pixels.
    """
    points = side * 72 * CELL_WIDTH / width
    return float(np.clip(LINE_SHARE * points, FINEST, LINE))


def _draw(axes: Axes, name: str, shot: Shot) -> None:
    patches, effects = require("matplotlib.patches"), require("matplotlib.patheffects")
    height, width = shot.image.shape[:2]
    axes.imshow(shot.image[:, :, ::-1], extent=(0, width, height, 0), interpolation="antialiased")
    boxes = [(shot.truth_xywh, TRUTH, "-"), (shot.tracker_xywh, TRACKER, _DASHES)]
    # In the first frame the tracker was given the truth.
    for box, colour, style in boxes[:1] if shot.number == 1 else boxes:
        if np.isfinite(box).all():
            x, y, w, h = box
            line = _line_width(min(w, h), width)
            rectangle = patches.Rectangle(
                (x, y), w, h, fill=False, edgecolor=colour, linewidth=line, linestyle=style
            )
            if colour == TRUTH:
                # A dark rim keeps it visible on its own colour; about the tracker's box it would
                # hide the truth.
                rim = effects.withStroke(linewidth=1.5 * line, foreground="black", alpha=0.5)
                rectangle.set_path_effects([rim])
            axes.add_patch(rectangle)
    # Boxes that reach outside do not make the picture smaller.
    axes.set(xlim=(0, width), ylim=(height, 0))
    if shot.number == 1:
        text = plain(name)
    elif math.isnan(shot.overlap):
        text = f"frame {shot.number}: no truth"
    else:
        text = f"frame {shot.number}: overlap {shot.overlap:.2f}"
    axes.set_title(text, fontsize=7, y=-0.02, va="top", pad=0)
