"""Folders of images and of masks, each mask a PNG image named like its picture.

DUTS, ECSSD and other datasets of salient objects come so: `DUTS-TR-Image/` and `DUTS-TR-Mask/`.
Masks lie in a folder whose name has "mask" or "ground truth" in it, or is `gt`; or beside the
pictures, as `a.jpg` and `a.png`. A mask that is bright somewhere, above 127, has one object, the
bright pixels. One that is not, or that has a palette, holds ids: each but 0 and 255 is an object.

Masks are decoded to read the boxes, one image at a time.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.formats.davis import read_mask
from re3.data.formats.files import dataset_name, subfolders
from re3.data.masks import IndexedMask, Mask, MaskImage
from re3.data.still_formats.picture import Picture, PictureEntry, boxes_array
from re3.video.images import sorted_images

LAYOUT = "images/ and masks/ with a .png an image, or a .png beside each .jpg"

_MASKS = re.compile(r"mask|ground.?truth|(^|[^a-z])gt([^a-z]|$)", re.IGNORECASE)
_VOID = 255
_PALETTE = 3
"""Kind of PNG, in its header."""


def detect(folder: Path) -> bool:
    """Whether a folder of masks lies beside one of images, or masks beside images."""
    return bool(_pairs(folder))


def entries(folder: Path) -> list[PictureEntry]:
    """The pictures that have a mask."""
    dataset = dataset_name(folder)
    return [
        PictureEntry(str(image.relative_to(folder)), partial(_read, image, mask, dataset))
        for image, mask in _pairs(folder)
    ]


def _read(image: Path, mask: Path, dataset: str) -> Picture:
    boxes, masks, size = _objects(mask)
    return Picture(image, boxes_array(boxes), tuple(masks), size, mask, dataset=dataset)


def _pairs(folder: Path) -> list[tuple[Path, Path]]:
    """Pictures with their masks, in natural order."""
    folders = subfolders(folder)
    found: list[tuple[Path, Path]] = []
    for masks in (path for path in folders if _MASKS.search(path.name)):
        by_name = {
            path.relative_to(masks).with_suffix(""): path
            for path in sorted_images(masks.rglob("*.png"))
        }
        for images in (path for path in folders if not _MASKS.search(path.name)):
            pictures = sorted_images(images.rglob("*"))
            found += [
                (path, by_name[name])
                for path in pictures
                if (name := path.relative_to(images).with_suffix("")) in by_name
            ]
    if found or not folder.is_dir():
        return found
    here = sorted_images(folder.iterdir())
    beside = {path.stem: path for path in here if path.suffix.lower() == ".png"}
    return [
        (path, beside[path.stem])
        for path in here
        if path.suffix.lower() in (".jpg", ".jpeg") and path.stem in beside
    ]


def _objects(
    path: Path,
) -> tuple[list[tuple[float, ...]], list[Mask | None], tuple[float, float]]:
    """Boxes and masks of the objects, and width and height of the mask in pixels."""
    if path.read_bytes()[25:26] == bytes([_PALETTE]):
        ids = read_mask(path)
    else:
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise ValueError(f"{path} cannot be read as an image; expected a mask: restore it")
        if grey.max() > 127:
            return [_box_around(grey > 127)], [MaskImage(path)], _size(grey)
        ids = read_mask(path)
    keys = [int(key) for key in np.flatnonzero(np.bincount(ids.ravel())) if key not in (0, _VOID)]
    boxes = [_box_around(ids == key) for key in keys]
    return boxes, [IndexedMask(path, key) for key in keys], _size(ids)


def _size(pixels: NDArray[np.uint8]) -> tuple[float, float]:
    return float(pixels.shape[1]), float(pixels.shape[0])


def _box_around(pixels: NDArray[np.bool_]) -> tuple[float, ...]:
    x, y, w, h = cv2.boundingRect(pixels.astype(np.uint8))
    return (float(x), float(y), float(w), float(h))
