"""LaSOT: `<class>/<class>-<N>/` with `img/`, `groundtruth.txt` and two files of marks.

Fan et al.: LaSOT, CVPR 2019. The folders of sequences may also lie directly in the dataset's, as
in copies of its test part. Boxes are `x,y,width,height` a line and 1-based, as the authors say.
`full_occlusion.txt` and `out_of_view.txt` hold 0 or 1 for every frame in one line. A frame that
either marks has nothing to see and gets no box, as in the authors' evaluation, which leaves them
out; the former also count as `occluded`. LaSOT marks no partial occlusion.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from re3.data.formats.files import (
    Entry,
    check_count,
    dataset_name,
    flags_of,
    has_images,
    images_in,
    subfolders,
    truth_of,
)
from re3.data.sequence import Sequence

LAYOUT = "<class>/<class>-<N>/ with img/, groundtruth.txt and full_occlusion.txt"

TRUTH = "groundtruth.txt"
_MARKS = ("full_occlusion.txt", "out_of_view.txt")


def detect(folder: Path) -> bool:
    """Whether the folder, one in it or one below that has `img/`, truth and LaSOT's marks."""
    return any(
        (path / "img").is_dir()
        and (path / TRUTH).is_file()
        and any((path / marks).is_file() for marks in _MARKS)
        for path in _candidates(folder)
    )


def entries(folder: Path) -> list[Entry]:
    """The sequences in a folder and in its folders of classes, or the one the folder is."""
    if (folder / TRUTH).is_file():
        folder = folder.absolute()
        return [Entry(folder.name, partial(_read, folder, dataset_name(folder.parent)))]
    dataset = dataset_name(folder)
    return [
        Entry(path.name, partial(_read, path, dataset))
        for path in _candidates(folder)
        if (path / "img").is_dir() or (path / TRUTH).is_file()
    ]


def _candidates(folder: Path) -> list[Path]:
    found = [folder]
    for path in subfolders(folder):
        if (path / "img").is_dir() or (path / TRUTH).is_file():
            found.append(path)
        elif not has_images(path):
            found.extend(subfolders(path))
    return found


def _read(folder: Path, dataset: str) -> list[Sequence]:
    images = images_in(folder / "img")
    path = folder / TRUTH
    boxes = truth_of(path, first_pixel=1)
    check_count(len(boxes), path, len(images), folder / "img")
    hidden, outside = (flags_of(folder / marks, len(boxes)) for marks in _MARKS)
    boxes[hidden | outside] = np.nan
    name = folder.absolute().name
    return [
        Sequence(
            name=name,
            source=folder / "img",
            boxes_xywh=boxes,
            label=name.rpartition("-")[0] or None,
            dataset=dataset,
            occluded=hidden,
        )
    ]
