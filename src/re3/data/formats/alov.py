"""ALOV300++: a tree of images and one of `.ann` texts, both by category.

Smeulders et al.: Visual tracking, an experimental survey, TPAMI 2014. Images lie in
`imagedata++/<category>/<video>/`, boxes in
`alov300++_rectangleAnnotation_full/<category>/<video>.ann`; the two top folders may have any name.
About every fifth frame is annotated: `frame x1 y1 x2 y2 x3 y3 x4 y4`, the frame's number being
that of its file and the corners in no order to rely on, so that the outermost box is taken.
Corners are 1-based (GOTURN's loader subtracts one as well). The category is what makes the video
hard and becomes its attribute.

Seven of the videos also occur in VOT 2014 and are left out where the dataset is trained on
(`IN_VOT2014`), as in Re3, sec. III-C.

Frames in between have no box; with `interpolate` they get one on the straight line between their
neighbours', as good for training as the object's motion is even.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from re3.data.formats.files import (
    Entry,
    Floats,
    dataset_name,
    files_with,
    has_images,
    images_in,
    lines_of,
    numbers_of,
    subfolders,
    track,
    usable,
)
from re3.data.sequence import Sequence

LAYOUT = "<images>/<category>/<video>/ and <annotations>/<category>/<video>.ann"

IN_VOT2014 = frozenset(
    {
        "01-Light_video00016",
        "01-Light_video00022",
        "01-Light_video00023",
        "02-SurfaceCover_video00012",
        "03-Specularity_video00003",
        "03-Specularity_video00012",
        "10-LowContrast_video00013",
    }
)
"""The videos that also occur in VOT 2014. The Re3 paper says that there are seven and leaves them
out, but does not name them; these are the seven that the README of GOTURN (Held et al., ECCV 2016),
the tracker it is compared with, names for the same reason."""

_EXPECTED = "frame x1 y1 x2 y2 x3 y3 x4 y4"


def detect(folder: Path) -> bool:
    """Whether a tree of `.ann` texts by category lies beside one of videos."""
    return _trees(folder) is not None


def entries(folder: Path, *, interpolate: bool = False) -> list[Entry]:
    """The videos that have an annotation."""
    trees = _trees(folder)
    if trees is None:
        return []
    images, texts = trees
    dataset = dataset_name(folder)
    return [
        Entry(
            text.stem,
            partial(_read, text, images / category.name / text.stem, dataset, interpolate),
        )
        for category in subfolders(texts)
        for text in files_with(category, ".ann")
    ]


def _trees(folder: Path) -> tuple[Path, Path] | None:
    """The folders of images and of annotations."""
    folders = [path for path in subfolders(folder) if not has_images(path)]
    for texts in folders:
        for category in subfolders(texts):
            names = [text.stem for text in files_with(category, ".ann")]
            for images in folders:
                if any((images / category.name / name).is_dir() for name in names):
                    return images, texts
    return None


def _read(text: Path, source: Path, dataset: str, interpolate: bool) -> list[Sequence]:
    images = images_in(source)
    index = {int(path.stem): t for t, path in enumerate(images) if path.stem.isdecimal()}
    boxes: dict[int, Floats] = {}
    for number, line in enumerate(lines_of(text, _EXPECTED), start=1):
        where = f"{text}, line {number}"
        numbers = numbers_of(line, where, _EXPECTED)
        if len(numbers) != 9:
            raise ValueError(f"{where}: {len(numbers)} numbers; expected {_EXPECTED}")
        if numbers[0] not in index:
            raise ValueError(f"{where}: {source} has no image {numbers[0]:g}; expected one")
        corners = np.array(numbers[1:]).reshape(4, 2)
        low, high = corners.min(axis=0), corners.max(axis=0)
        box = usable([[*low, *(high - low)]], first_pixel=1)[0]
        if not np.isnan(box).any():
            boxes[index[int(numbers[0])]] = box
    if not boxes:
        raise ValueError(f"{text}: no line has a box with an area; expected {_EXPECTED}")
    made = track(boxes)
    if interpolate:
        made["boxes_xywh"] = _fill(made["boxes_xywh"])
    category = re.sub(r"^\d+-", "", source.parent.name)
    return [
        Sequence(name=text.stem, source=source, dataset=dataset, attributes=(category,), **made)
    ]


def _fill(boxes_xywh: Floats) -> Floats:
    """Boxes `[T, 4]`, those without one on the line between their neighbours with one."""
    known = np.flatnonzero(~np.isnan(boxes_xywh[:, 0]))
    frames = np.arange(len(boxes_xywh))
    return np.stack([np.interp(frames, known, side[known]) for side in boxes_xywh.T], axis=1)
