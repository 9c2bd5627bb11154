"""YOLO folders: images, and texts of normalised boxes, one for each.

A line is `class cx cy width height` in shares of the picture's width and height, or `class x1 y1 x2
y2 ...`, the outline of an object as a polygon. Texts lie in `labels/` as the images do in
`images/`, with or without folders of splits below, or beside the images. An image without a text,
or with an empty one, has no objects and is left out.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from re3.data.formats.files import dataset_name, numbers_of
from re3.data.masks import Mask, Polygons
from re3.data.still_formats.picture import Picture, PictureEntry, boxes_array
from re3.video.images import sorted_images

LAYOUT = "images/ and labels/ with a .txt an image (class cx cy w h, normalised), or both together"

_EXPECTED = "class cx cy width height, or class x1 y1 x2 y2 x3 y3 ..., each from 0 to 1"
_SLACK = 0.02
"""Rounding, and boxes a little outside, that labelling tools are known to write."""
_LOOKED_AT = 20
"""Texts that are opened before a folder is taken for something else."""


def detect(folder: Path) -> bool:
    """Whether there are images with texts of normalised boxes."""
    labelled = islice(_labelled(*_trees(folder)), _LOOKED_AT)
    return any(_looks_like_labels(text) for _, text in labelled)


def entries(folder: Path) -> list[PictureEntry]:
    """The pictures that have a text."""
    images, labels = _trees(folder)
    dataset = dataset_name(folder)
    return [
        PictureEntry(str(image.relative_to(images)), partial(_read, image, text, dataset))
        for image, text in _labelled(images, labels)
    ]


def _read(image: Path, text: Path, dataset: str) -> Picture:
    boxes, masks = _read_labels(text)
    return Picture(image, boxes_array(boxes), tuple(masks), relative=True, dataset=dataset)


def _trees(folder: Path) -> tuple[Path, Path]:
    """The folder of the images and that of their texts."""
    images, labels = folder / "images", folder / "labels"
    return (images, labels) if images.is_dir() and labels.is_dir() else (folder, folder)


def _labelled(images: Path, labels: Path) -> Iterator[tuple[Path, Path]]:
    """The images that have a text, with all folders below `images`, or in the one folder alone."""
    for root, folders, names in os.walk(images):
        folders.sort()
        if images == labels:
            folders.clear()
        for image in sorted_images(Path(root) / name for name in names):
            text = (labels / image.relative_to(images)).with_suffix(".txt")
            if text.is_file():
                yield image, text


def _looks_like_labels(text: Path) -> bool:
    try:
        boxes, _ = _read_labels(text)
    except (ValueError, OSError):
        return False
    return bool(boxes)


def _read_labels(text: Path) -> tuple[list[tuple[float, ...]], list[Mask | None]]:
    """Boxes, normalised xywh, and outlines of the objects of a picture."""
    boxes: list[tuple[float, ...]] = []
    masks: list[Mask | None] = []
    try:
        lines = text.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{text} is not UTF-8 text ({error}); expected {_EXPECTED}") from error
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        where = f"{text}, line {number}"
        kind, *values = numbers_of(line, where, _EXPECTED)
        fits = len(values) == 4 or (len(values) >= 6 and len(values) % 2 == 0)
        inside = all(-_SLACK <= value <= 1 + _SLACK for value in values)
        if not fits or not inside or kind % 1 or kind < 0:
            raise ValueError(f"{where}: {line.strip()[:60]!r}; expected {_EXPECTED}")
        if len(values) == 4:
            x, y, w, h = values
            boxes.append((x - w / 2, y - h / 2, w, h))
            masks.append(None)
            continue
        ring = np.array(values, dtype=np.float32).reshape(-1, 2)
        low, size = ring.min(axis=0), np.ptp(ring, axis=0)
        boxes.append((*low.tolist(), *size.tolist()))
        masks.append(Polygons((ring,), relative=True))
    return boxes, masks
