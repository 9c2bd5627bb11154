"""Pictures with an index `boxes.jsonl`, a line of JSON a picture.

`{"image": path, "mask": path or null, "width": W, "height": H,
"objects": [{"label": name, "box_xywh": [x, y, w, h]}]}`, paths relative to the folder. A mask is
bright on the object; it is that of all objects of its picture together.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from re3.data.formats.files import dataset_name, needed
from re3.data.json_tracks import text_lines
from re3.data.masks import MaskImage
from re3.data.still_formats.picture import Picture, PictureEntry, boxes_array

INDEX_NAME = "boxes.jsonl"
LAYOUT = f"{INDEX_NAME} with a line of JSON for each picture"

_EXPECTED = '{"image", "mask", "width", "height", "objects": [{"box_xywh": [x, y, w, h]}]}'


def detect(folder: Path) -> bool:
    """Whether there is an index in the folder."""
    return (folder / INDEX_NAME).is_file()


def entries(folder: Path) -> list[PictureEntry]:
    """The pictures of the index.

    Raises:
        FileNotFoundError: no index in the folder.
        ValueError: it is not UTF-8.
    """
    index = folder / INDEX_NAME
    needed(index, "a line of JSON for each picture")
    return [
        PictureEntry(f"{INDEX_NAME}, line {number}", partial(_read, folder, number, line))
        for number, line in text_lines(index)
    ]


def _read(folder: Path, number: int, line: str) -> Picture:
    try:
        entry = json.loads(line)
        boxes = boxes_array([o["box_xywh"] for o in entry["objects"]])
        size = (float(entry["width"]), float(entry["height"]))
        image, mask = folder / entry["image"], entry.get("mask")
    except (KeyError, TypeError, ValueError) as error:
        where = f"{folder / INDEX_NAME}, line {number}"
        raise ValueError(f"{where}: {error!r}; expected {_EXPECTED}") from error
    outline = MaskImage(folder / mask) if mask else None
    return Picture(
        image,
        boxes,
        (outline,) * len(boxes),
        size,
        folder / INDEX_NAME,
        dataset=dataset_name(folder),
    )
