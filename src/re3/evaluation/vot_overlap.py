"""Overlap in whole pixels, as vot-toolkit 0.9.0 counts it: of boxes, and of boxes with polygons.

The toolkit draws both regions into a raster that spans the two and lies inside the frame, and
counts pixels. Here the pixels of a box, and of each row of a polygon, are counted without one.

Coordinates are kept in float32 and rounded to whole numbers first, halves to the even one; of a
box x, y, width and height each by itself. Conventions that the figures depend on:

* A box covers the pixels x..x + width - 1 and y..y + height - 1.
* A polygon covers in each row the pixels between its edges, both ends and the last row included, so
  an upright one is a pixel wider and higher than the box of the same numbers. An edge's place in a
  row is cut off to a whole number, towards the raster's left side.
* Pixels outside the frame do not count.
* Regions that together span at most one column or row of pixels overlap by 1 if that is so before
  the frame cuts them, and by 0 if only after.

The overlap differs from that of the exact regions, the more the smaller they are.
"""

from __future__ import annotations

from collections.abc import Sequence as List

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Polygons = List[Floats | None]
"""Of each frame the truth's polygon `[P, 2]`, x and y in pixels; None where it is a box."""


def pixel_overlaps(
    boxes_xywh: ArrayLike,
    truth_xywh: ArrayLike,
    size: tuple[int, int],
    polygons: Polygons | None = None,
) -> Floats:
    """Overlap of boxes with the truth; see the head of this module.

    Args:
        boxes_xywh: `[T, 4]`; NaN where there is no box.
        truth_xywh: `[T, 4]`; NaN where there is no truth.
        size: width and height of the frame.
        polygons: T of them, each taken in place of the true box; None where all are boxes.

    Returns:
        `[T]`, 0..1; 0 where either is NaN.

    Raises:
        ValueError: the shapes differ or are not `[T, 4]`, or there are not T polygons.
    """
    given = [np.asarray(boxes, dtype=np.float64) for boxes in (boxes_xywh, truth_xywh)]
    if given[0].ndim != 2 or given[0].shape[1] != 4 or given[0].shape != given[1].shape:
        raise ValueError(
            f"boxes have shape {given[0].shape} and the truth {given[1].shape}; "
            "expected [T, 4] for both"
        )
    if polygons is not None and len(polygons) != len(given[0]):
        raise ValueError(
            f"{len(polygons)} polygons for {len(given[0])} boxes; expected one a box, None where "
            "the truth is a box too"
        )
    there = np.flatnonzero(np.isfinite(np.concatenate(given, axis=1)).all(axis=1))
    result = np.zeros(len(given[0]))
    result[there] = _of_boxes(given[0][there], given[1][there], size)
    if polygons is not None:
        for index in there.tolist():
            polygon = polygons[index]
            if polygon is not None:
                result[index] = polygon_overlap(given[0][index], polygon, size)
    return result


def polygon_overlap(box_xywh: ArrayLike, polygon: ArrayLike, size: tuple[int, int]) -> float:
    """Overlap of a box with a polygon; see the head of this module.

    Args:
        box_xywh: `[4]` in pixels, finite.
        polygon: `[P, 2]`, x and y in pixels, finite, P of 3 or more; it is closed.
        size: width and height of the frame.

    Returns:
        0..1.
    """
    box_first, box_last = (corner[0] for corner in _pixels(np.asarray(box_xywh)[None]))
    points = _rounded(np.asarray(polygon))
    first = np.minimum(box_first, points.min(axis=0))
    last = np.maximum(box_last, points.max(axis=0))
    if (first >= last).any():
        return 1.0
    first, last = np.maximum(first, 0), np.minimum(last, np.array(size) - 1)
    if (first >= last).any():
        return 0.0
    # From here on in pixels of the raster; last ones are included.
    left, top = np.maximum(box_first, first) - first
    right, bottom = np.minimum(box_last, last) - first
    rows, starts, ends = _spans(points - first, *(last - first + 1).astype(int))
    in_box = (rows >= top) & (rows <= bottom)
    shared = np.minimum(ends, right) - np.maximum(starts, left) + 1
    common = np.maximum(shared, 0)[in_box].sum()
    box_area = max(right - left + 1, 0) * max(bottom - top + 1, 0)
    union = box_area + (ends - starts + 1).sum() - common
    return float(common / union) if union > 0 else 0.0


def _spans(points: Floats, width: int, height: int) -> tuple[Floats, Floats, Floats]:
    """The pixels of a polygon in a raster: of each run its row, its first and last pixel.

    Args:
        points: `[P, 2]`, whole numbers, in pixels of the raster.
        width, height: of the raster.
    """
    y_low, y_high = points[:, 1].min(), points[:, 1].max()
    rows = np.arange(max(y_low, 0), min(y_high, height - 1) + 1)
    # Where an edge crosses a row, [R, P]; an edge without height counts as its second end.
    end, start = points, np.roll(points, 1, axis=0)
    run, rise = (start - end).T
    touched = (rows[:, None] >= np.minimum(start, end)[:, 1]) & (
        rows[:, None] <= np.maximum(start, end)[:, 1]
    )
    slope = np.divide(rows[:, None] - end[:, 1], rise, where=rise != 0, out=np.zeros(touched.shape))
    crossings = np.where(touched, np.trunc(end[:, 0] + slope * run), np.inf)
    crossings.sort(axis=1)
    counts = touched.sum(axis=1)
    # Pairs of crossings enclose a run of pixels. Of two alike the first is passed over unless they
    # are the last: a corner is touched by two edges. Rows differ in where their next pair begins.
    found: list[tuple[Floats, Floats, Floats]] = []
    place, reached = np.zeros(len(rows), dtype=int), np.full(len(rows), -1.0)
    every = np.arange(len(rows))
    # One more, so that there is a crossing after the last.
    crossings = np.pad(crossings, ((0, 0), (0, 1)), constant_values=np.inf)
    while True:
        first = crossings[every, np.minimum(place, len(points))]
        active = (place < counts - 1) & (first < width)
        if not active.any():
            break
        last = crossings[every, np.minimum(place + 1, len(points))]
        corner = active & (first == last) & (place < counts - 2)
        pair = active & ~corner & (last >= 0)
        begin = np.maximum(np.maximum(first, 0), reached + 1)
        stop = np.minimum(last, width - 1)
        reached = np.where(pair, np.maximum(stop, reached), reached)
        drawn = pair & (begin <= stop)
        found.append((rows[drawn], begin[drawn], stop[drawn]))
        place = place + np.where(corner, 1, 2)
    columns = zip(*found, strict=True) if found else ([np.empty(0)],) * 3
    row, begin, stop = (np.concatenate(column) for column in columns)
    return row, begin, stop


def _of_boxes(boxes_xywh: Floats, truth_xywh: Floats, size: tuple[int, int]) -> Floats:
    (first_a, last_a), (first_b, last_b) = _pixels(boxes_xywh), _pixels(truth_xywh)
    # All [N, 2], x and y; last pixels are included.
    first, last = np.minimum(first_a, first_b), np.maximum(last_a, last_b)
    first_seen, last_seen = np.maximum(first, 0), np.minimum(last, np.array(size) - 1)

    def area(begin: Floats, end: Floats) -> Floats:
        begin, end = np.maximum(begin, first_seen), np.minimum(end, last_seen)
        return np.maximum(end - begin + 1, 0).prod(axis=1)

    common = area(np.maximum(first_a, first_b), np.minimum(last_a, last_b))
    union = area(first_a, last_a) + area(first_b, last_b) - common
    overlaps = np.divide(common, union, out=np.zeros(len(union)), where=union > 0)
    overlaps[(first_seen >= last_seen).any(axis=1)] = 0.0
    overlaps[(first >= last).any(axis=1)] = 1.0
    return overlaps


def _pixels(boxes_xywh: Floats) -> tuple[Floats, Floats]:
    """First and last pixel of boxes, each `[N, 2]`."""
    rounded = _rounded(boxes_xywh)
    return rounded[:, :2], rounded[:, :2] + rounded[:, 2:] - 1


def _rounded(numbers: NDArray) -> Floats:
    return np.round(numbers.astype(np.float32)).astype(np.float64)
