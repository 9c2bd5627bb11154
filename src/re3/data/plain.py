"""Readers of the plain form: a clip and, beside it, a file of boxes.

Two kinds of annotation, both UTF-8 text named like the clip:

* `clip.txt`, one object: `x,y,width,height` a line and a line a frame, separated by commas, tabs
  or spaces; `nan,nan,nan,nan`, or a box without area, where the object is absent.
* `clip.jsonl`, several objects: a JSON object a line and a line a frame,
  `{"frame": 0, "objects": [{"id": 1, "label": "dog", "box_xywh": [x, y, width, height]}]}`;
  an object missing from a frame is absent there. Or a line an object and frame, as `re3 track`
  writes results; see `re3.data.json_tracks`.

A clip is a video file or a folder of images; a folder may also hold its boxes itself, as
`groundtruth_rect.txt`, and its images under `img`. Boxes are in pixels of the stored frames and
0-based, whatever the file is called: OTB's own files are 1-based and need one subtracted.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from re3.data.json_tracks import object_box, text_lines, tracks_of
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
        boxes[row] = object_box(tuple(box), f"{path}, line {row + 1}") or _ABSENT
    if np.isnan(boxes).all():
        raise ValueError(f"{path}: no line has a box; expected at least one x,y,width,height")
    images = clip / INNER_IMAGES
    return Sequence(
        name=clip_name(clip),
        source=images if images.is_dir() else clip,
        boxes_xywh=boxes,
        dataset=_dataset_of(clip),
        row_a_frame=True,
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
    boxes, labels = tracks_of(path)
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
    lines = text_lines(path)
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
        table = " (a table with a header?)" if where.endswith(", line 1") else ""
        raise ValueError(
            f"{where}: {line.strip()!r} is not four numbers{table}; {_EXPECTED}"
        ) from None
    if len(box) != 4:
        lines = " (lines of MOTChallenge, frame,id,x,y,width,height,...?)" if len(box) > 6 else ""
        raise ValueError(f"{where}: {len(box)} numbers in {line.strip()!r}{lines}; {_EXPECTED}")
    if not np.isfinite(box).all() and not np.isnan(box).all():
        raise ValueError(f"{where}: {line.strip()!r} is not finite; {_EXPECTED}")
    return box


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
