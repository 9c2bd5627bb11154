"""VisDrone, of several objects (MOT, VID) and of one (SOT): `sequences/` and `annotations/`.

Zhu et al.: Detection and tracking meet drones challenge, TPAMI 2021. Images lie in
`sequences/<sequence>/`, the text of a sequence in `annotations/<sequence>.txt`, in folders such as
`VisDrone2019-MOT-train`. What a line holds tells the two kinds apart:

* `frame,id,left,top,width,height,score,category,truncation,occlusion`, several objects. Frames are
  counted from 1. Each id becomes a sequence, from its first to its last frame. Lines with score 0
  and ignored regions (category 0) are left out. Occlusion 2, 50 to 100 % of the object, counts as
  occluded, the line that is drawn for MOTChallenge.
* `left,top,width,height`, one object and a line a frame; a box without area where it is absent.

Boxes are taken for 0-based: the data set's description does not say, and zeros occur in them.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from re3.data.formats.files import (
    Entry,
    check_count,
    dataset_name,
    files_with,
    images_in,
    lines_of,
    numbers_of,
    pad_to_images,
    subfolders,
    track,
    truth_of,
    usable,
)
from re3.data.sequence import Sequence

LAYOUT = "sequences/<sequence>/ with images and annotations/<sequence>.txt, or folders with them"

OCCLUDED = 2
"""Mark of an object that is hidden by half or more."""

LABELS = {
    1: "pedestrian",
    2: "people",
    3: "bicycle",
    4: "car",
    5: "van",
    6: "truck",
    7: "tricycle",
    8: "awning-tricycle",
    9: "bus",
    10: "motor",
    11: "others",
}

_EXPECTED = "frame,id,left,top,width,height,score,category,truncation,occlusion"


def detect(folder: Path) -> bool:
    """Whether the folder, or one in it, has `sequences/` and texts in `annotations/`."""
    return bool(_parts(folder))


def entries(folder: Path) -> list[Entry]:
    """The sequences that have an annotation, part by part."""
    return [
        Entry(text.stem, partial(_read, text, part / "sequences" / text.stem, dataset_name(part)))
        for part in _parts(folder)
        for text in files_with(part / "annotations", ".txt")
    ]


def _parts(folder: Path) -> list[Path]:
    return [
        path
        for path in [folder, *subfolders(folder)]
        if (path / "sequences").is_dir() and files_with(path / "annotations", ".txt")
    ]


def _read(text: Path, source: Path, dataset: str) -> list[Sequence]:
    images = len(images_in(source))
    lines = lines_of(text, f"{_EXPECTED}, or left,top,width,height")
    if len(numbers_of(lines[0], f"{text}, line 1", _EXPECTED)) == 4:
        boxes = pad_to_images(truth_of(text, first_pixel=0), images)
        check_count(len(boxes), text, images, source)
        return [Sequence(name=text.stem, source=source, boxes_xywh=boxes, dataset=dataset)]
    return _tracks(text, lines, source, images, dataset)


def _tracks(
    text: Path, lines: list[str], source: Path, images: int, dataset: str
) -> list[Sequence]:
    boxes: dict[int, dict[int, tuple[float, ...]]] = {}
    occluded: dict[int, dict[int, bool]] = {}
    labels: dict[int, str] = {}
    for number, line in enumerate(lines, start=1):
        where = f"{text}, line {number}"
        fields = numbers_of(line, where, _EXPECTED)
        if len(fields) != 10 or not np.isfinite(fields).all():
            raise ValueError(f"{where}: {len(fields)} numbers in {line!r}; expected {_EXPECTED}")
        frame, key, category = int(fields[0]) - 1, int(fields[1]), int(fields[7])
        if not 0 <= frame < images:
            raise ValueError(f"{where}: frame {frame + 1}; expected 1 to {images}, as {source} has")
        box = usable([fields[2:6]])[0]
        if fields[6] == 0 or category == 0 or np.isnan(box).any():
            continue
        if frame in boxes.setdefault(key, {}):
            raise ValueError(f"{where}: id {key} comes twice in frame {frame + 1}")
        boxes[key][frame] = tuple(box.tolist())
        occluded.setdefault(key, {})[frame] = fields[9] == OCCLUDED
        labels.setdefault(key, LABELS.get(category, "object"))
    return [
        Sequence(
            name=f"{text.stem}/{key}",
            source=source,
            label=labels[key],
            dataset=dataset,
            **track(boxes[key], occluded[key]),
        )
        for key in sorted(boxes)
    ]
