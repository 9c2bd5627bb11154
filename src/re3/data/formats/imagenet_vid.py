"""ImageNet Video (ILSVRC VID): `Data/VID/<split>/.../*.JPEG` and `Annotations/VID/.../*.xml`.

Russakovsky et al.: ImageNet large scale visual recognition challenge, IJCV 2015. An XML file a
frame lists the objects with `trackid`, `name` (a WordNet id), corners, `occluded` and `generated`.
Every track id of a video becomes a sequence, from its first to its last frame, without box in
between where the object is gone. Corners are taken for 0-based pixels, both inclusive, so that a
box is `xmax - xmin + 1` wide.

A `generated` box was interpolated by the labelling tool, not drawn. Both kinds are read; without
`generated` a frame whose box is interpolated has none.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path

import numpy as np

from re3.data.formats.files import (
    ABSENT,
    Entry,
    dataset_name,
    files_with,
    images_in,
    subfolders,
    track,
    track_name,
    usable,
)
from re3.data.picture_size import check_size
from re3.data.sequence import Sequence
from re3.natural_order import natural_key

LAYOUT = "Data/VID/<split>/ with images and Annotations/VID/<split>/ with an .xml a frame"

LABELS = {
    "n02691156": "airplane",
    "n02419796": "antelope",
    "n02131653": "bear",
    "n02834778": "bicycle",
    "n01503061": "bird",
    "n02924116": "bus",
    "n02958343": "car",
    "n02402425": "cattle",
    "n02084071": "dog",
    "n02121808": "domestic cat",
    "n02503517": "elephant",
    "n02118333": "fox",
    "n02510455": "giant panda",
    "n02342885": "hamster",
    "n02374451": "horse",
    "n02129165": "lion",
    "n01674464": "lizard",
    "n02484322": "monkey",
    "n03790512": "motorcycle",
    "n02324045": "rabbit",
    "n02509815": "red panda",
    "n02411705": "sheep",
    "n01726692": "snake",
    "n02355227": "squirrel",
    "n02129604": "tiger",
    "n04468005": "train",
    "n01662784": "turtle",
    "n04530566": "watercraft",
    "n02062744": "whale",
    "n02391049": "zebra",
}
"""The 30 kinds of VID; another id stands for itself."""

_EXPECTED = "<object> with trackid, name, bndbox (xmin, xmax, ymin, ymax), occluded and generated"


def detect(folder: Path) -> bool:
    """Whether there are `Data/VID` and `Annotations/VID`."""
    return (folder / "Data" / "VID").is_dir() and (folder / "Annotations" / "VID").is_dir()


def entries(folder: Path, *, generated: bool = True) -> list[Entry]:
    """The videos that have annotations, split by split."""
    root = dataset_name(folder)
    return [
        Entry(
            video.name,
            partial(
                _read,
                video,
                folder / "Data" / "VID" / video.relative_to(folder / "Annotations" / "VID"),
                f"{root}-{split.name}",
                generated,
            ),
        )
        for split in subfolders(folder / "Annotations" / "VID")
        for video in _videos(split)
    ]


def _videos(folder: Path) -> list[Path]:
    """The folders with XML files: of training two levels below the split, else one."""
    if any(path.suffix == ".xml" for path in folder.iterdir()):
        return [folder]
    return [video for path in subfolders(folder) for video in _videos(path)]


def _read(video: Path, source: Path, dataset: str, generated: bool) -> list[Sequence]:
    images = images_in(source)
    index = {path.stem: t for t, path in enumerate(images)}
    boxes: dict[str, dict[int, tuple[float, ...]]] = {}
    occluded: dict[str, dict[int, bool]] = {}
    labels: dict[str, str] = {}
    texts = files_with(video, ".xml")
    if len(texts) != len(index):
        raise ValueError(
            f"{video} has {len(texts)} .xml files, but {source} {len(index)} images; expected one "
            "a frame"
        )
    # All frames of a video are of one size: the first stands for them.
    if texts and texts[0].stem in index:
        check_size(images[index[texts[0].stem]], _size(texts[0]), texts[0])
    for text in texts:
        if text.stem not in index:
            raise ValueError(f"{text}: {source} has no image {text.stem}; expected one")
        frame = index[text.stem]
        for key, label, box, is_occluded, is_generated in _objects(text):
            if frame in boxes.setdefault(key, {}):
                raise ValueError(f"{text}: track {key} comes twice; expected one object a track")
            wanted = not np.isnan(box).any() and (generated or not is_generated)
            if wanted:
                boxes[key][frame] = box
                occluded.setdefault(key, {})[frame] = is_occluded
            labels.setdefault(key, label)
    tracks = {key: boxes[key] for key in sorted(boxes, key=natural_key) if boxes[key]}
    return [
        Sequence(
            name=track_name(video.name, key, len(tracks)),
            source=source,
            label=labels[key],
            dataset=dataset,
            **track(tracks[key], occluded[key]),
        )
        for key in tracks
    ]


def _size(text: Path) -> tuple[float, float] | None:
    """Width and height that an XML file states of its image; None where it states none."""
    try:
        root = ET.parse(text).getroot()
        width, height = (float(root.findtext(f"size/{side}") or 0) for side in ("width", "height"))
    except (ET.ParseError, ValueError) as error:
        raise ValueError(f"{text}: {error}; expected {_EXPECTED}") from error
    return (width, height) if min(width, height) > 0 else None


def _objects(text: Path) -> list[tuple[str, str, tuple[float, ...], bool, bool]]:
    """Track id, label, box_xywh or NaN, occluded and generated of every object of a frame."""
    try:
        root = ET.parse(text).getroot()
        return [_object(element) for element in root.findall("object")]
    except (ET.ParseError, ValueError) as error:
        raise ValueError(f"{text}: {error}; expected {_EXPECTED}") from error


def _object(element: ET.Element) -> tuple[str, str, tuple[float, ...], bool, bool]:
    def field(name: str) -> str:
        text = element.findtext(name)
        if text is None:
            raise ValueError(f"an object has no {name}")
        return text.strip()

    left, top, right, bottom = (
        float(field(f"bndbox/{side}")) for side in ("xmin", "ymin", "xmax", "ymax")
    )
    box = (left, top, right - left + 1, bottom - top + 1)
    name = field("name")
    return (
        field("trackid"),
        LABELS.get(name, name),
        ABSENT if np.isnan(usable([box])).any() else box,
        field("occluded") == "1",
        field("generated") == "1",
    )
