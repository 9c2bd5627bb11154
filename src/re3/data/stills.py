"""Still pictures with boxes, and masks where there are any: the simulator's raw material."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.geometry import Floats

INDEX_NAME = "boxes.jsonl"
SMALLEST_SHARE = 0.01
"""Objects that cover less of the image, 0.1 squared, are discarded (Re3, sec. III-C)."""


@dataclass(frozen=True, eq=False)
class Still:
    """A picture with at least one object large enough.

    Attributes:
        image: path of the picture.
        mask: path of a mask of its (single) object, or None.
        boxes_xywh: float64 `[N, 4]` in pixels of the picture.
    """

    image: Path
    mask: Path | None
    boxes_xywh: Floats

    def read(self) -> NDArray[np.uint8]:
        """The picture, uint8 `[H, W, 3]` BGR; raises ValueError if it cannot be read."""
        return _read(self.image, cv2.IMREAD_COLOR)

    def read_mask(self) -> NDArray[np.uint8] | None:
        """The mask, uint8 `[H, W]` of 0 and 255, or None; raises ValueError if unreadable."""
        if self.mask is None:
            return None
        return np.where(_read(self.mask, cv2.IMREAD_GRAYSCALE) > 127, 255, 0).astype(np.uint8)


def _read(path: Path, flags: int) -> NDArray[np.uint8]:
    image = cv2.imread(str(path), flags)
    if image is None:
        raise ValueError(
            f"{path} cannot be read as an image; remove it from the index or restore it"
        )
    return image


def read_stills(folder: str | Path) -> list[Still]:
    """Read a folder with an index `boxes.jsonl`.

    A line a picture: `{"image": path, "mask": path or null, "width": W, "height": H,
    "objects": [{"label": name, "box_xywh": [x, y, w, h]}]}`, paths relative to the folder.
    Objects below `SMALLEST_SHARE` of the picture are left out, and pictures without others.

    Raises:
        FileNotFoundError: no index in the folder.
        ValueError: a line that is not such a description; nothing left to use.
    """
    folder = Path(folder)
    index = folder / INDEX_NAME
    if not index.is_file():
        raise FileNotFoundError(f"{index} does not exist; expected a line of JSON for each picture")
    stills = []
    for number, line in enumerate(index.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            entry = json.loads(line)
            boxes = np.array([o["box_xywh"] for o in entry["objects"]], dtype=np.float64)
            area = float(entry["width"]) * float(entry["height"])
            image, mask = folder / entry["image"], entry.get("mask")
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(
                f"{index}, line {number}: {error!r}; expected "
                '{"image", "mask", "width", "height", "objects": [{"box_xywh": [x, y, w, h]}]}'
            ) from error
        boxes = boxes.reshape(-1, 4)
        boxes = boxes[boxes[:, 2] * boxes[:, 3] >= SMALLEST_SHARE * area]
        if len(boxes):
            stills.append(Still(image, folder / mask if mask else None, boxes))
    if not stills:
        raise ValueError(
            f"{index} has no object of {SMALLEST_SHARE:.0%} of its picture or more; "
            "smaller ones lack the detail to be tracked"
        )
    return stills
