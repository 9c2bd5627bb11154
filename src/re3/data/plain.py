"""Readers of the plain form: a clip and, beside it, a file of boxes.

Two kinds of annotation, both UTF-8 text named like the clip:

* `clip.txt`, one object: `x,y,width,height` a line and a line a frame, separated by commas, tabs
  or spaces; `nan,nan,nan,nan`, or a box without area, where the object is absent.
* `clip.jsonl`, several objects: a JSON object a line and a line a frame,
  `{"frame": 0, "objects": [{"id": 1, "label": "dog", "box_xywh": [x, y, width, height]}]}`;
  an object missing from a frame is absent there.

A clip is a video file or a folder of images; a folder may also hold its boxes itself, as
`groundtruth_rect.txt`, and its images under `img`. Boxes are in pixels of the stored frames and
0-based, whatever the file is called: OTB's own files are 1-based and need one subtracted.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence
from re3.natural_order import natural_key
from re3.video.sources import IMAGE_SUFFIXES

VIDEO_SUFFIXES = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".webm"})
INNER_TRUTH = "groundtruth_rect.txt"
INNER_IMAGES = "img"
TRACKS_SUFFIX = ".jsonl"

_ABSENT = (np.nan, np.nan, np.nan, np.nan)
_EXPECTED = "expected x,y,width,height, or nan,nan,nan,nan where the object is absent"


def read_track(clip: str | Path, annotation: str | Path | None = None) -> Sequence:
    """Read a clip with one object.

    Args:
        clip: a video file or a folder of images.
        annotation: the text file of boxes; by default the one beside the clip (or, of a folder,
            `groundtruth_rect.txt` in it).

    Raises:
        FileNotFoundError: no such clip or annotation.
        ValueError: a line is not a box, or none is; names the file and the line.
    """
    clip = _existing(Path(clip))
    path = _existing(Path(annotation) if annotation is not None else _truth_of(clip))
    boxes = read_boxes(path)
    for row, box in enumerate(boxes):
        boxes[row] = _object_box(tuple(box), f"{path}, line {row + 1}") or _ABSENT
    if np.isnan(boxes).all():
        raise ValueError(f"{path}: no line has a box; expected at least one x,y,width,height")
    images = clip / INNER_IMAGES
    return Sequence(
        name=clip_name(clip),
        source=images if images.is_dir() else clip,
        boxes_xywh=boxes,
        dataset=_dataset_of(clip),
    )


def read_tracks(clip: str | Path, annotation: str | Path | None = None) -> list[Sequence]:
    """Read a clip with several objects: one sequence an id, from its first to its last frame.

    Args:
        clip: a video file or a folder of images.
        annotation: the JSON lines; by default the `.jsonl` file beside the clip.

    Returns:
        sequences in natural order of their ids, named `<clip>/<id>`; rows of NaN in between
        where the object is absent.

    Raises:
        FileNotFoundError: no such clip or annotation.
        ValueError: a line is not of the form above, or no line has an object; names the file and
            the line.
    """
    clip = _existing(Path(clip))
    path = _existing(Path(annotation) if annotation is not None else _beside(clip, TRACKS_SUFFIX))
    boxes: dict[str, dict[int, tuple[float, ...]]] = {}
    labels: dict[str, str] = {}
    seen: set[int] = set()
    for number, line in _lines(path):
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        frame, objects = _parse_frame(line, where)
        if frame in seen:
            raise ValueError(f"{where}: frame {frame} comes twice; expected a line a frame")
        seen.add(frame)
        for item in objects:
            key, label, box = _parse_object(item, where)
            track = boxes.setdefault(key, {})
            if frame in track:
                raise ValueError(f"{where}: object {key!r} comes twice in frame {frame}")
            if box is not None:
                track[frame] = box
            if label is not None:
                labels.setdefault(key, label)
    sequences = []
    for key in sorted(boxes, key=natural_key):
        track = boxes[key]
        if not track:
            continue
        start, end = min(track), max(track)
        sequences.append(
            Sequence(
                name=f"{clip_name(clip)}/{key}",
                source=clip,
                boxes_xywh=np.array([track.get(t, _ABSENT) for t in range(start, end + 1)]),
                label=labels.get(key),
                dataset=_dataset_of(clip),
                start_frame=start,
            )
        )
    if not sequences:
        raise ValueError(f"{path}: no frame has an object with a box; expected at least one")
    return sequences


def read_folder(folder: str | Path) -> list[Sequence]:
    """Find and read every annotated clip in a folder and the folders below it, in natural order.

    Clips without annotation and files that are neither are passed over.

    Raises:
        FileNotFoundError, NotADirectoryError: no such folder.
        ValueError: no annotated clip in it, or an annotation is not well formed.
    """
    folder = _existing(Path(folder))
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder} is not a folder; expected one with annotated clips")
    clips = annotated_clips(folder)
    if not clips:
        raise ValueError(
            f"{folder} holds no annotated clip; expected videos or folders of images, each with "
            "a .txt or .jsonl file of the same name beside it"
        )
    return [sequence for clip, annotation in clips for sequence in read_clip(clip, annotation)]


def annotated_clips(folder: Path) -> list[tuple[Path, Path]]:
    """Every clip in a folder and the folders below it, each with its annotation, in natural order.

    A clip with two annotations comes twice.
    """
    found = []
    # A folder given directly may itself be a clip of images with its truth inside.
    for path in [folder, *sorted(folder.rglob("*"), key=lambda p: _path_key(p, folder))]:
        if path.is_dir():
            if (path / INNER_TRUTH).is_file():
                found.append((path, path / INNER_TRUTH))
                continue
            if path == folder or not _has_images(path):
                continue
        elif path.suffix.lower() not in VIDEO_SUFFIXES:
            continue
        beside = (_beside(path, suffix) for suffix in (".txt", TRACKS_SUFFIX))
        found += [(path, annotation) for annotation in beside if annotation.is_file()]
    return found


def read_clip(clip: Path, annotation: Path) -> list[Sequence]:
    """Read a clip with an annotation of either kind; raises as `read_track` and `read_tracks`."""
    if annotation.suffix == TRACKS_SUFFIX:
        return read_tracks(clip, annotation)
    return [read_track(clip, annotation)]


def read_boxes(path: str | Path) -> NDArray[np.float64]:
    """Read a text of boxes, `x,y,width,height` a line, of an annotation or a tracker's result.

    Returns:
        float64 `[T, 4]` as written: finite or a row of NaN, of any size.

    Raises:
        ValueError: a line is not four numbers; names the file and the line.
    """
    path = Path(path)
    lines = _lines(path)
    while lines and not lines[-1][1].strip():
        lines.pop()
    if not lines:
        raise ValueError(f"{path} is empty; expected x,y,width,height a line, a line a frame")
    return np.array([_parse_box(line, f"{path}, line {number}") for number, line in lines])


def clip_name(clip: Path) -> str:
    """The name of a clip: that of the file without its suffix, or of the folder."""
    clip = clip.absolute()
    return clip.name if clip.is_dir() else clip.stem


def _parse_box(line: str, where: str) -> tuple[float, ...]:
    fields = [field for field in re.split(r"[,;\s]+", line.strip()) if field]
    try:
        box = tuple(float(field) for field in fields)
    except ValueError:
        raise ValueError(f"{where}: {line.strip()!r} is not four numbers; {_EXPECTED}") from None
    if len(box) != 4:
        raise ValueError(f"{where}: {len(box)} numbers in {line.strip()!r}; {_EXPECTED}")
    if not np.isfinite(box).all() and not np.isnan(box).all():
        raise ValueError(f"{where}: {line.strip()!r} is not finite; {_EXPECTED}")
    return box


def _object_box(box: tuple[float, ...], where: str) -> tuple[float, ...] | None:
    """The box, or None where it says that the object is absent: all NaN, or without area."""
    if np.isnan(box).all():
        return None
    if not np.isfinite(box).all() or box[2] < 0 or box[3] < 0:
        numbers = ", ".join(f"{value:g}" for value in box)
        raise ValueError(f"{where}: box {numbers} is not finite or has a negative size")
    return box if box[2] > 0 and box[3] > 0 else None


def _parse_frame(line: str, where: str) -> tuple[int, list[Any]]:
    expected = 'expected {"frame": 0, "objects": [...]}'
    try:
        record = json.loads(line)
    except json.JSONDecodeError as error:
        raise ValueError(f"{where}: not JSON ({error}); {expected}") from error
    if not isinstance(record, dict) or not isinstance(record.get("objects"), list):
        raise ValueError(f"{where}: no list of objects; {expected}")
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
    return str(item["id"]), name, _object_box(numbers, where)


def _lines(path: Path) -> list[tuple[int, str]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text ({error}); expected an annotation") from error
    return list(enumerate(text.splitlines(), start=1))


def _existing(path: Path) -> Path:
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist; expected a clip or its annotation")
    return path


def _truth_of(clip: Path) -> Path:
    inner = clip / INNER_TRUTH
    return inner if inner.is_file() else _beside(clip, ".txt")


def _beside(clip: Path, suffix: str) -> Path:
    return clip.absolute().parent / f"{clip_name(clip)}{suffix}"


def _dataset_of(clip: Path) -> str:
    folder = clip.absolute().parent
    # Links keep their own name; only a path that ends in ".." has to be followed for one.
    return folder.name if folder.name != ".." else folder.resolve().name


def _has_images(folder: Path) -> bool:
    if (folder / INNER_IMAGES).is_dir():
        folder = folder / INNER_IMAGES
    return any(path.suffix.lower() in IMAGE_SUFFIXES for path in folder.iterdir())


def _path_key(path: Path, folder: Path) -> tuple[tuple[tuple[int, str], ...], ...]:
    parts = path.relative_to(folder).parts
    # Without its suffix first: bmx.mp4 comes before bmx2.mp4.
    stem = natural_key(path.stem)
    return (*(natural_key(part) for part in parts[:-1]), stem, natural_key(path.name))
