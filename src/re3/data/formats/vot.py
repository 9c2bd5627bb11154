"""VOT 2013 to 2020: `list.txt` and a folder a sequence with `groundtruth.txt` and the images.

Kristan et al., The Visual Object Tracking challenge results. Images are `00000001.jpg` and on, in
the sequence's folder (in older years) or in `color/` below it. A line of truth is one of

* `x,y,width,height`, a box;
* `x1,y1,x2,y2,x3,y3,x4,y4` or any other polygon, for which the outermost axis-aligned box is
  taken, as in the Re3 paper; the polygon itself is kept beside it;
* `mX,Y,WIDTH,HEIGHT,n0,n1,...`, a mask (from 2020): runs of zeros and ones in turn, row by row, of
  the region at X,Y; its box is that of the ones;
* a single number or NaN: nothing to follow in this frame.

Coordinates are taken as they stand, 0-based, as the challenge's own tool kit rasterises them.
Files such as `occlusion.tag` or `occlusion.label` mark frames with 0 or 1 a line; those of
`occlusion` become `occluded`, and every one that marks a frame is an attribute of the sequence.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from re3.data.formats.files import (
    ABSENT,
    Entry,
    Floats,
    check_count,
    dataset_name,
    files_with,
    flags_of,
    has_images,
    images_in,
    lines_of,
    numbers_of,
    subfolders,
    usable,
)
from re3.data.formats.got10k import is_got10k_sequence
from re3.data.sequence import Sequence

LAYOUT = "list.txt and folders with groundtruth.txt and images, or with color/"

TRUTH = "groundtruth.txt"
_EXPECTED = "x,y,width,height, a polygon of x,y pairs or a mask mX,Y,WIDTH,HEIGHT,RUNS"


def detect(folder: Path) -> bool:
    """Whether the folder, or one in it, has `groundtruth.txt` with images beside it."""
    return any(_is_sequence(path) for path in [folder, *subfolders(folder)])


def entries(folder: Path) -> list[Entry]:
    """The sequences of `list.txt`, or all in the folder, or the one the folder is."""
    if (folder / TRUTH).is_file():
        folder = folder.absolute()
        return [Entry(folder.name, partial(_read, folder, dataset_name(folder.parent)))]
    if (folder / "list.txt").is_file():
        lines = lines_of(folder / "list.txt", "the name of a sequence a line")
        paths = [folder / line.strip() for line in lines if line.strip()]
    else:
        paths = [path for path in subfolders(folder) if _is_sequence(path)]
    dataset = dataset_name(folder)
    return [Entry(path.name, partial(_read, path, dataset)) for path in paths]


def parse_region(line: str, where: str) -> tuple[float, ...]:
    """The axis-aligned box_xywh around a region of a truth file; NaN throughout for none.

    Raises:
        ValueError: the line is none of the kinds above; the message starts with `where`.
    """
    return _box_and_polygon(line, where)[0]


def read_truth(path: Path) -> tuple[Floats, tuple[Floats | None, ...]]:
    """Read a truth file.

    Returns:
        boxes_xywh `[T, 4]`, NaN where there is nothing to follow; and of each frame the polygon
        `[P, 2]`, None where the line is something else or has no area.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is empty, or a line is none of the kinds above; names the file and the line.
    """
    regions = [
        _box_and_polygon(line, f"{path}, line {number}")
        for number, line in enumerate(lines_of(path, _EXPECTED), start=1)
    ]
    boxes = usable([box for box, _ in regions])
    there = ~np.isnan(boxes[:, 0])
    return boxes, tuple(
        polygon if here else None for (_, polygon), here in zip(regions, there, strict=True)
    )


def _box_and_polygon(line: str, where: str) -> tuple[tuple[float, ...], Floats | None]:
    text = line.strip()
    if text.startswith("m"):
        return _mask_box(numbers_of(text[1:], where, _EXPECTED), where), None
    numbers = numbers_of(text, where, _EXPECTED)
    if len(numbers) == 1 or (numbers and np.isnan(numbers).all()):
        return ABSENT, None
    if len(numbers) == 4:
        return tuple(numbers), None
    if len(numbers) < 6 or len(numbers) % 2:
        raise ValueError(f"{where}: {len(numbers)} numbers; expected {_EXPECTED}")
    polygon = np.array(numbers).reshape(-1, 2)
    (left, top), (right, bottom) = polygon.min(axis=0).tolist(), polygon.max(axis=0).tolist()
    return (left, top, right - left, bottom - top), polygon


def _mask_box(numbers: list[float], where: str) -> tuple[float, ...]:
    if len(numbers) < 4 or any(number % 1 or number < 0 for number in numbers[2:]):
        raise ValueError(f"{where}: not a mask; expected {_EXPECTED} of whole numbers")
    left, top = numbers[:2]
    width, height, *runs = (int(number) for number in numbers[2:])
    if sum(runs) > width * height:
        raise ValueError(
            f"{where}: the mask's runs are {sum(runs)} pixels long; expected at most "
            f"{width} x {height}"
        )
    pixels = np.zeros(width * height, dtype=bool)
    ends = np.cumsum([0, *runs])
    # Every second run is of ones.
    for start, end in list(pairwise(ends))[1::2]:
        pixels[start:end] = True
    rows, columns = np.nonzero(pixels.reshape(height, width))
    if not len(rows):
        return ABSENT
    low = np.array([columns.min(), rows.min()])
    high = np.array([columns.max(), rows.max()])
    return (*(np.array([left, top]) + low).tolist(), *(high - low + 1).tolist())


def _is_sequence(folder: Path) -> bool:
    return (
        (folder / TRUTH).is_file()
        and ((folder / "color").is_dir() or has_images(folder))
        and not is_got10k_sequence(folder)
    )


def _read(folder: Path, dataset: str) -> list[Sequence]:
    source = folder / "color"
    images = images_in(source if source.is_dir() else folder)
    path = folder / TRUTH
    boxes, polygons = read_truth(path)
    check_count(len(boxes), path, len(images), images[0].parent)
    marks = {
        tag.stem: flags_of(tag, len(boxes), may_end_early=True)
        for suffix in (".label", ".tag")
        for tag in files_with(folder, suffix)
    }
    return [
        Sequence(
            name=folder.absolute().name,
            source=images[0].parent,
            boxes_xywh=boxes,
            dataset=dataset,
            occluded=marks.get("occlusion"),
            attributes=tuple(tag.replace("_", " ") for tag in sorted(marks) if marks[tag].any()),
            polygons=polygons,
        )
    ]
