"""MOTChallenge: a folder a sequence with `img1/`, `gt/gt.txt` and `seqinfo.ini`.

Leal-Taixé et al. 2015; Milan et al. 2016; Dendorfer et al. 2020. The sequences may lie in parts
such as `train/`; those of `test/` have no truth and are left out. Lines are
`frame,id,left,top,width,height,consider,class,visibility` (from MOT16 on), 1-based throughout.
Each id becomes a sequence, from its first to its last frame.

Lines whose `consider` is 0 are left out: distractors, vehicles, people in mirrors and whatever
else the benchmark does not count. A visibility below 0.5 counts as occluded, as more than half of
the box is then hidden or out of the frame. MOT15 has ten fields, the last three a position in
space: everything is a person there, and nothing is said of occlusion.

MOT17 holds every sequence three times, for three detectors; the truth is the same.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from re3.data.formats.files import (
    Entry,
    dataset_name,
    has_images,
    images_in,
    lines_of,
    numbers_of,
    setting,
    subfolders,
    track,
    usable,
)
from re3.data.picture_size import check_size
from re3.data.sequence import Sequence

LAYOUT = "folders with img1/ and gt/gt.txt, or train/ with them"

OCCLUDED_VISIBILITY = 0.5
"""Below it an object counts as occluded."""

LABELS = {
    1: "person",
    2: "person on vehicle",
    3: "car",
    4: "bicycle",
    5: "motorbike",
    6: "non-motorised vehicle",
    7: "static person",
    8: "distractor",
    9: "occluder",
    10: "occluder on the ground",
    11: "full occluder",
    12: "reflection",
    13: "crowd",
}

_EXPECTED = "frame,id,left,top,width,height,consider,class,visibility"


def detect(folder: Path) -> bool:
    """Whether the folder, one in it or one below that has `gt/gt.txt`."""
    return any((path / "gt" / "gt.txt").is_file() for path in _candidates(folder))


def entries(folder: Path) -> list[Entry]:
    """The clips that have a truth."""
    return [
        Entry(path.name, partial(_read, path, dataset_name(path.parent)))
        for path in (path.absolute() for path in _candidates(folder))
        if (path / "gt").is_dir()
    ]


def _candidates(folder: Path) -> list[Path]:
    found = [folder]
    for path in subfolders(folder):
        found.append(path)
        if not has_images(path):
            found.extend(subfolders(path))
    return found


def _read(folder: Path, dataset: str) -> list[Sequence]:
    info = folder / "seqinfo.ini"  # Old sequences lack it.
    source = folder / (setting(info, "Sequence", "imDir") or "img1")
    frames = images_in(source)
    images = len(frames)
    sides = [setting(info, "Sequence", name) for name in ("imWidth", "imHeight")]
    if all(side is not None and side.isdecimal() for side in sides):
        check_size(frames[0], (float(sides[0] or 0), float(sides[1] or 0)), info)
    length = setting(info, "Sequence", "seqLength")
    if length not in (None, str(images)):
        raise ValueError(
            f"{info} says that there are {length} frames, but {source} has "
            f"{images} images; expected as many"
        )
    path = folder / "gt" / "gt.txt"
    boxes: dict[int, dict[int, tuple[float, ...]]] = {}
    occluded: dict[int, dict[int, bool]] = {}
    labels: dict[int, str] = {}
    for number, line in enumerate(lines_of(path, _EXPECTED), start=1):
        where = f"{path}, line {number}"
        fields = numbers_of(line, where, _EXPECTED)
        if not 7 <= len(fields) <= 10 or not np.isfinite(fields).all():
            raise ValueError(f"{where}: {len(fields)} numbers in {line!r}; expected {_EXPECTED}")
        frame, key = int(fields[0]) - 1, int(fields[1])
        if not 0 <= frame < images:
            raise ValueError(f"{where}: frame {frame + 1}; expected 1 to {images}, as {source} has")
        box = usable([fields[2:6]], first_pixel=1)[0]
        if fields[6] == 0 or np.isnan(box).any():
            continue
        if frame in boxes.setdefault(key, {}):
            raise ValueError(f"{where}: id {key} comes twice in frame {frame + 1}")
        boxes[key][frame] = tuple(box.tolist())
        is_mot16 = len(fields) in (8, 9)
        labels.setdefault(key, LABELS.get(int(fields[7]), "object") if is_mot16 else LABELS[1])
        if len(fields) == 9:
            occluded.setdefault(key, {})[frame] = fields[8] < OCCLUDED_VISIBILITY
    return [
        Sequence(
            # Ids of people are many: the name always has one.
            name=f"{folder.name}/{key}",
            source=source,
            label=labels[key],
            dataset=dataset,
            **track(boxes[key], occluded.get(key)),
        )
        for key in sorted(boxes)
    ]
