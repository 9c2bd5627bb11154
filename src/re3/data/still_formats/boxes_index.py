"""Pictures with an index `boxes.jsonl`, a line of JSON a picture.

`{"image": path, "mask": path or null, "width": W, "height": H,
"objects": [{"label": name, "box_xywh": [x, y, w, h]}]}`, paths relative to the folder. A mask is
bright on the object; it is that of all objects of its picture together.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from re3.data.formats.files import dataset_name
from re3.data.masks import MaskImage
from re3.data.stills import Still, make_still

INDEX_NAME = "boxes.jsonl"
LAYOUT = f"{INDEX_NAME} with a line of JSON for each picture"

_EXPECTED = '{"image", "mask", "width", "height", "objects": [{"box_xywh": [x, y, w, h]}]}'


def detect(folder: Path) -> bool:
    """Whether there is an index in the folder."""
    return (folder / INDEX_NAME).is_file()


def read(folder: Path, smallest_share: float) -> list[Still]:
    """The pictures of the index.

    Raises:
        FileNotFoundError: no index in the folder.
        ValueError: a line that is not such a description.
    """
    index = folder / INDEX_NAME
    if not index.is_file():
        raise FileNotFoundError(f"{index} does not exist; expected a line of JSON for each picture")
    stills = []
    for number, line in enumerate(index.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            entry = json.loads(line)
            boxes = np.array([o["box_xywh"] for o in entry["objects"]], dtype=np.float64)
            boxes = boxes.reshape(-1, 4)
            area = float(entry["width"]) * float(entry["height"])
            image, mask = folder / entry["image"], entry.get("mask")
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{index}, line {number}: {error!r}; expected {_EXPECTED}") from error
        outline = MaskImage(folder / mask) if mask else None
        still = make_still(
            image,
            boxes,
            area,
            smallest_share,
            masks=[outline] * len(boxes),
            dataset=dataset_name(folder),
        )
        if still is not None:
            stills.append(still)
    return stills
