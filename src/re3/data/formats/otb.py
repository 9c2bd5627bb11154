"""OTB: a folder a sequence with `img/` and `groundtruth_rect.txt`.

Wu, Lim, Yang: Object tracking benchmark, TPAMI 2015. Boxes are `x,y,width,height` a line,
separated by commas, tabs or spaces, and 1-based. A sequence with two targets has
`groundtruth_rect.1.txt` and `groundtruth_rect.2.txt` and becomes two, `Jogging-1` and `Jogging-2`.

The benchmark uses a part of six sequences only (`RANGES`). Their truth comes in two kinds, told
apart by the number of rows: as many as images, or as many as the range has frames.
"""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

from re3.data.formats.files import (
    Entry,
    Floats,
    check_count,
    dataset_name,
    images_in,
    lines_of,
    subfolders,
    truth_of,
)
from re3.data.sequence import Sequence

LAYOUT = "folders with img/ and groundtruth_rect.txt"

RANGES = {
    "david": (300, 770),
    "diving": (1, 215),
    "football1": (1, 74),
    "freeman3": (1, 460),
    "freeman4": (1, 283),
    "tiger1": (6, 354),
}
"""Name in lower case -> first and last frame of the benchmark, 1-based, both inclusive."""

ATTRIBUTES = {
    "IV": "illumination variation",
    "OPR": "out-of-plane rotation",
    "SV": "scale variation",
    "OCC": "occlusion",
    "DEF": "deformation",
    "MB": "motion blur",
    "FM": "fast motion",
    "IPR": "in-plane rotation",
    "OV": "out of view",
    "BC": "background clutter",
    "LR": "low resolution",
}
"""In the order of the tool kit, which files of zeros and ones follow."""

_TRUTH = re.compile(r"groundtruth_rect(?:\.?(\d+))?\.txt")


def detect(folder: Path) -> bool:
    """Whether the folder, or one in it, has `img/` and a `groundtruth_rect*.txt`."""
    return any((path / "img").is_dir() and _truths(path) for path in [folder, *subfolders(folder)])


def entries(folder: Path) -> list[Entry]:
    """The sequences in a folder, or the one the folder is."""
    if (folder / "img").is_dir():
        folder = folder.absolute()
        return [Entry(folder.name, partial(_read, folder, dataset_name(folder.parent)))]
    dataset = dataset_name(folder)
    return [
        Entry(path.name, partial(_read, path, dataset))
        for path in subfolders(folder)
        if (path / "img").is_dir() or _truths(path)
    ]


def _truths(folder: Path) -> list[tuple[str | None, Path]]:
    """The files of boxes, each with its number where it has one."""
    found = [(_TRUTH.fullmatch(path.name), path) for path in sorted(folder.iterdir())]
    return [(match.group(1), path) for match, path in found if match]


def _read(folder: Path, dataset: str) -> list[Sequence]:
    source = folder / "img"
    images = images_in(source)
    truths = _truths(folder)
    if not truths:
        raise FileNotFoundError(f"{folder} has no groundtruth_rect.txt; expected boxes beside img/")
    # Human4 comes with an empty file beside the one that counts.
    truths = [(key, path) for key, path in truths if path.stat().st_size] or truths
    name = folder.absolute().name
    attributes = _attributes(folder)
    sequences = []
    for number, path in truths:
        boxes, start = _cut(name, truth_of(path, first_pixel=1), path, len(images), source)
        sequences.append(
            Sequence(
                name=name if number is None else f"{name}-{number}",
                source=source,
                boxes_xywh=boxes,
                dataset=dataset,
                start_frame=start,
                attributes=attributes,
            )
        )
    return sequences


def _cut(name: str, boxes: Floats, path: Path, images: int, source: Path) -> tuple[Floats, int]:
    """The benchmark's part of a sequence: its boxes and the index of its first frame."""
    first, last = RANGES.get(name.lower(), (1, images))
    if len(boxes) == last - first + 1 < images and images >= last:
        return boxes, first - 1
    check_count(len(boxes), path, images, source)
    # A copy with fewer images than the range needs has been cut before.
    return (boxes[first - 1 : last], first - 1) if images >= last else (boxes, 0)


def _attributes(folder: Path) -> tuple[str, ...]:
    """What `attrs.txt` or `cfg.json` says: abbreviations, or zeros and ones in the kit's order."""
    words: list[str] = []
    if (path := folder / "attrs.txt").is_file():
        words = re.findall(r"\w+", " ".join(lines_of(path, "attributes, e.g. IV, OPR")))
        if set(words) <= {"0", "1"}:
            if len(words) != len(ATTRIBUTES):
                raise ValueError(
                    f"{path} has {len(words)} marks; expected {len(ATTRIBUTES)}, one each for "
                    + ", ".join(ATTRIBUTES)
                )
            words = [key for key, mark in zip(ATTRIBUTES, words, strict=True) if mark == "1"]
    elif (path := folder / "cfg.json").is_file():
        try:
            words = [str(word) for word in json.loads(path.read_bytes()).get("attributes", [])]
        except (ValueError, AttributeError) as error:
            raise ValueError(f"{path}: {error}; expected a JSON object of settings") from error
    return tuple(ATTRIBUTES.get(word.upper(), word) for word in words)
