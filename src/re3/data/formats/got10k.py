"""GOT-10k: `list.txt` and a folder a sequence with images, `groundtruth.txt` and labels.

Huang, Zhao, Huang: GOT-10k, TPAMI 2019. The dataset has the parts `train`, `val` and `test`; the
folder of one part is a dataset as well. Boxes are `x,y,width,height` a line and 1-based, as the
authors say. `absence.label` marks frames without the object, which get no box. `meta_info.ini`
names the object. Sequences of `test` give away the first box alone.

`cover.label` says how much of the object is visible, from 0 (nothing) over 4 (45 to 60 %) to 8
(all). Frames up to 4 count as occluded: 4 is the level in which half the object is hidden, the
line that is drawn for MOTChallenge too, while 7 (above 90 %) is hardly an occlusion.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from re3.data.formats.files import (
    Entry,
    check_count,
    dataset_name,
    flags_of,
    has_images,
    images_in,
    lines_of,
    numbers_of,
    pad_to_images,
    setting,
    subfolders,
    truth_of,
)
from re3.data.sequence import Sequence

LAYOUT = "list.txt and folders with images, groundtruth.txt and absence.label, or train/ and val/"

OCCLUDED_COVER = 4
"""Highest level of `cover.label` that counts as occluded."""

TRUTH = "groundtruth.txt"
_PARTS = ("train", "val", "test")
_LABELS = ("absence.label", "cover.label", "meta_info.ini")


def detect(folder: Path) -> bool:
    """Whether the folder, one in it, or one in its parts is a sequence with GOT-10k's labels."""
    parts = [folder, *(folder / part for part in _PARTS)]
    return any(is_got10k_sequence(path) for part in parts for path in [part, *subfolders(part)])


def is_got10k_sequence(folder: Path) -> bool:
    """Whether a folder has images, `groundtruth.txt` and GOT-10k's labels, or one box alone."""
    if not (folder / TRUTH).is_file() or not has_images(folder):
        return False
    if any((folder / label).is_file() for label in _LABELS):
        return True
    # A test sequence has the first box and nothing else; VOT has a line a frame.
    rows = (folder / TRUTH).read_bytes().split()
    return len(rows) == 1 and rows[0].count(b",") == 3 and len(images_in(folder)) > 1


def entries(folder: Path) -> list[Entry]:
    """The sequences of every part, in the order of `list.txt` where there is one."""
    if (folder / TRUTH).is_file():
        folder = folder.absolute()
        return [Entry(folder.name, partial(_read, folder, dataset_name(folder.parent)))]
    parts = [folder / part for part in _PARTS if (folder / part).is_dir()] or [folder]
    return [
        Entry(path.name, partial(_read, path, dataset_name(part)))
        for part in parts
        for path in _sequences(part)
    ]


def _sequences(part: Path) -> list[Path]:
    if not (part / "list.txt").is_file():
        return [path for path in subfolders(part) if (path / TRUTH).is_file()]
    lines = lines_of(part / "list.txt", "the name of a sequence a line")
    return [part / line.strip() for line in lines if line.strip()]


def _read(folder: Path, dataset: str) -> list[Sequence]:
    images = images_in(folder)
    path = folder / TRUTH
    boxes = truth_of(path, first_pixel=1)
    if not (folder / "absence.label").is_file():
        boxes = pad_to_images(boxes, len(images))
    check_count(len(boxes), path, len(images), folder)
    if (folder / "absence.label").is_file():
        boxes[flags_of(folder / "absence.label", len(boxes))] = np.nan
    occluded = None
    if (folder / "cover.label").is_file():
        occluded = _cover(folder / "cover.label", len(boxes)) <= OCCLUDED_COVER
    return [
        Sequence(
            name=folder.absolute().name,
            source=folder,
            boxes_xywh=boxes,
            label=setting(folder / "meta_info.ini", "METAINFO", "object_class"),
            dataset=dataset,
            occluded=occluded,
        )
    ]


def _cover(path: Path, rows: int) -> NDArray[np.float64]:
    """Levels of visibility `[rows]`, 0..8."""
    levels: list[float] = []
    for number, line in enumerate(lines_of(path, "a level from 0 to 8 a frame"), start=1):
        where = f"{path}, line {number}"
        values = numbers_of(line, where, "a level from 0 to 8")
        if not set(values) <= set(range(9)):
            raise ValueError(f"{where}: {line.strip()!r}; expected a level from 0 to 8")
        levels.extend(values)
    if len(levels) != rows:
        raise ValueError(f"{path} has {len(levels)} levels; expected {rows}, one a frame")
    return np.array(levels)
