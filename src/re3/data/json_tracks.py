"""Boxes of several objects in JSON Lines, in either of two forms.

* A line a frame, `{"frame": 0, "objects": [{"id": 1, "label": "dog", "box_xywh": [x, y, width,
  height]}]}`; an object missing from a frame is absent there.
* A line an object and frame, as `re3 track --results clip.jsonl` writes them: `{"frame": 0,
  "timestamp": 0.0, "object": "dog", "x": 1, "y": 2, "w": 3, "h": 4, "score": 0.9, "status":
  "tracked"}`. Where the tracker called the object lost it has no box: what stands there is where
  the tracker last looked for it.

Frames are counted from 0 in both.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from re3.result import Status

Boxes = dict[str, dict[int, tuple[float, ...]]]
"""Object -> frame -> box_xywh."""

_EXPECTED_FRAME = 'expected {"frame": 0, "objects": [...]}'
_SIDES = ("x", "y", "w", "h")
_EXPECTED_ROW = 'expected {"frame": 0, "object": "dog", "x": 1, "y": 2, "w": 3, "h": 4, ...}'


def tracks_of(path: Path) -> tuple[Boxes, dict[str, str]]:
    """The boxes of JSON lines of either form, and the label of each object that has one.

    Raises:
        ValueError: a line is of neither form, or of the other one than the first; names the file
            and the line.
    """
    boxes: Boxes = {}
    labels: dict[str, str] = {}
    seen: set[int] = set()
    rows: bool | None = None
    for number, line in text_lines(path):
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        record = _parse_json(line, where)
        if rows is None:
            rows = _is_row(record)
        if rows:
            frame, key, box = _parse_row(record, where)
            found: list[tuple[str, str | None, tuple[float, ...] | None]] = [(key, None, box)]
        else:
            frame, objects = _parse_frame(record, where)
            if frame in seen:
                raise ValueError(f"{where}: frame {frame} comes twice; expected a line a frame")
            seen.add(frame)
            found = [_parse_object(item, where) for item in objects]
        for key, label, box in found:
            track = boxes.setdefault(key, {})
            if frame in track:
                raise ValueError(f"{where}: object {key!r} comes twice in frame {frame}")
            if box is not None:
                track[frame] = box
            if label is not None:
                labels.setdefault(key, label)
    return boxes, labels


def object_box(box: tuple[float, ...], where: str) -> tuple[float, ...] | None:
    """The box, or None where it says that the object is absent: all NaN, or without area."""
    if np.isnan(box).all():
        return None
    if not np.isfinite(box).all() or box[2] < 0 or box[3] < 0:
        numbers = ", ".join(f"{value:g}" for value in box)
        raise ValueError(
            f"{where}: box {numbers} is not finite or has a negative size; where the object is "
            "absent, write nan,nan,nan,nan in a .txt, or leave the object out of a .jsonl"
        )
    return box if box[2] > 0 and box[3] > 0 else None


def text_lines(path: Path) -> list[tuple[int, str]]:
    """The lines of an annotation, each with its number; raises ValueError unless it is UTF-8."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text ({error}); expected an annotation") from error
    return list(enumerate(text.splitlines(), start=1))


def _parse_json(line: str, where: str) -> Any:
    try:
        return json.loads(line)
    except json.JSONDecodeError as error:
        raise ValueError(f"{where}: not JSON ({error}); {_EXPECTED_FRAME}") from error


def _parse_frame(record: Any, where: str) -> tuple[int, list[Any]]:
    if not isinstance(record, dict) or not isinstance(record.get("objects"), list):
        raise ValueError(f"{where}: no list of objects; {_EXPECTED_FRAME}")
    frame = record.get("frame")
    if not isinstance(frame, int) or isinstance(frame, bool) or frame < 0:
        raise ValueError(f"{where}: frame is {frame!r}; expected a whole number from 0 on")
    return frame, record["objects"]


def _parse_object(item: Any, where: str) -> tuple[str, str | None, tuple[float, ...] | None]:
    expected = 'expected {"id": 1, "label": "dog", "box_xywh": [x, y, width, height]}'
    if not isinstance(item, dict) or not isinstance(item.get("id"), (int, str)):
        raise ValueError(f"{where}: object {item!r} has no id; {expected}")
    box = item.get("box_xywh")
    if not isinstance(box, list) or len(box) != 4:
        raise ValueError(f"{where}: box {box!r} of object {item['id']!r}; {expected}")
    try:
        numbers = tuple(float(value) for value in box)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: box {box!r} is not four numbers; {expected}") from None
    label = item.get("label")
    name = None if label is None else str(label)
    return str(item["id"]), name, object_box(numbers, where)


def _is_row(record: Any) -> bool:
    """Whether a line's object is such a row."""
    return isinstance(record, dict) and "object" in record and "objects" not in record


def _parse_row(record: Any, where: str) -> tuple[int, str, tuple[float, ...] | None]:
    """The frame, the object and its box_xywh; None instead of a box where the object was lost.

    Raises:
        ValueError: it is not such a row; the message starts with `where`.
    """
    if not _is_row(record):
        raise ValueError(f"{where}: {str(record)[:60]!r} is not a row of results; {_EXPECTED_ROW}")
    frame, name = record.get("frame"), record["object"]
    if not isinstance(frame, int) or isinstance(frame, bool) or frame < 0:
        raise ValueError(f"{where}: frame is {frame!r}; expected a whole number from 0 on")
    if not isinstance(name, (str, int)):
        raise ValueError(f"{where}: object is {name!r}; {_EXPECTED_ROW}")
    try:
        box = tuple(float(record[side]) for side in _SIDES)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{where}: no number {error}; {_EXPECTED_ROW}") from error
    if not all(map(math.isfinite, box)) or min(box[2:]) < 0:
        numbers = ", ".join(f"{value:g}" for value in box)
        raise ValueError(f"{where}: box {numbers} is not finite or has a negative size")
    there = record.get("status") != Status.LOST.value and min(box[2:]) > 0
    return frame, str(name), box if there else None
