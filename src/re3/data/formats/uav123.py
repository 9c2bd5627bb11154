"""UAV123 and UAV20L: `anno/<set>/<sequence>.txt` and `data_seq/<set>/<folder>/`.

Mueller, Smith, Ghanem: A benchmark and simulator for UAV tracking, ECCV 2016. Every set in `anno`
is read, e.g. `UAV123` and `UAV20L`, as a dataset of its own; UAV20L has its images in
`data_seq/UAV123`. Boxes are `x,y,width,height` a line and 1-based, as in the OTB tool kit this one
was made from; NaN where the object is absent. `anno/<set>/att/<sequence>.txt` holds zeros and
ones in the order of `ATTRIBUTES`.

Long videos were cut up: `group1_1`, `group1_2` share the folder `group1`. Every part begins with
the last frame of the one before it, except those in `STARTS`, which follow a gap.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from re3.data.formats.files import (
    Entry,
    files_with,
    images_in,
    lines_of,
    numbers_of,
    subfolders,
    truth_of,
)
from re3.data.sequence import Sequence

LAYOUT = "anno/<set>/<sequence>.txt and data_seq/<set>/<folder>/ with images"

STARTS = {"bird1_2": 774, "bird1_3": 1572, "uav1_3": 2472}
"""Index of the first frame, at 30 frames a second, of parts that follow a gap."""
SLOWER = 3
"""The copy at 10 frames a second keeps every third frame."""

ATTRIBUTES = (
    "scale variation",
    "aspect ratio change",
    "low resolution",
    "fast motion",
    "full occlusion",
    "partial occlusion",
    "out of view",
    "background clutter",
    "illumination variation",
    "viewpoint change",
    "camera motion",
    "similar object",
)


def detect(folder: Path) -> bool:
    """Whether there are `data_seq/` and a set with texts in `anno/`."""
    return (folder / "data_seq").is_dir() and any(
        files_with(path, ".txt") for path in subfolders(folder / "anno")
    )


def entries(folder: Path) -> list[Entry]:
    """The sequences of every set in `anno`."""
    sets = [path for path in subfolders(folder / "anno") if files_with(path, ".txt")]
    return [
        Entry(text.stem, partial(_read, text))
        for annotations in sets
        for text in files_with(annotations, ".txt")
    ]


def _read(text: Path) -> list[Sequence]:
    source, part = _source_of(text)
    images = len(images_in(source))
    boxes = truth_of(text, first_pixel=1)
    start = _start_of(text, part, len(boxes), images)
    if start + len(boxes) > images:
        raise ValueError(
            f"{text} has {len(boxes)} lines from frame {start + 1} of the folder on, but {source} "
            f"{images} images; expected an image for every line"
        )
    return [
        Sequence(
            name=text.stem,
            source=source,
            boxes_xywh=boxes,
            dataset=text.parent.name,
            start_frame=start,
            attributes=_attributes(text.parent / "att" / text.name),
        )
    ]


def _source_of(text: Path) -> tuple[Path, int]:
    """The folder of images and the number of the part, 1 of a sequence that was not cut."""
    name = text.stem
    stem, _, number = name.rpartition("_")
    frames = text.parents[2] / "data_seq"
    for folder in (frames / text.parent.name, frames / "UAV123"):
        if (folder / name).is_dir():
            return folder / name, 1
        if stem and number.isdecimal() and (folder / stem).is_dir():
            return folder / stem, int(number)
    raise FileNotFoundError(
        f"{frames / text.parent.name / name} does not exist; expected the images of {text.name}"
    )


def _start_of(text: Path, part: int, rows: int, images: int) -> int:
    """Index of a part's first frame in the folder of the whole video."""
    if part == 1:
        return 0
    if (start := STARTS.get(text.stem)) is not None:
        # Too short for 30 frames a second: the copy at 10.
        return start if start + rows <= images else start // SLOWER
    before = text.with_name(re.sub(r"\d+$", str(part - 1), text.stem) + text.suffix)
    length = len(truth_of(before, first_pixel=1))
    return _start_of(before, part - 1, length, images) + length - 1


def _attributes(path: Path) -> tuple[str, ...]:
    if not path.is_file():
        return ()
    marks = [
        mark
        for number, line in enumerate(lines_of(path, "zeros and ones"), start=1)
        for mark in numbers_of(line, f"{path}, line {number}", "zeros and ones")
    ]
    if len(marks) != len(ATTRIBUTES) or not set(marks) <= {0.0, 1.0}:
        raise ValueError(f"{path}: {marks}; expected {len(ATTRIBUTES)} zeros and ones")
    return tuple(name for name, mark in zip(ATTRIBUTES, marks, strict=True) if mark)
