"""DAVIS: `JPEGImages/480p/<sequence>/` and masks in `Annotations/480p/<sequence>/`.

Perazzi et al., CVPR 2016; Pont-Tuset et al., 2017. A mask is a PNG named like its image: of 2017
with a palette whose index is the object's id, of 2016 in grey with any value for the one object.
Each id becomes a sequence of the boxes around its pixels, from the first frame it is in to the
last. With `merge` all ids of a clip are one object, as DAVIS-2016 has it. A clip whose only mask
is that of the first frame, as in the test parts, gives that box.

Masks are decoded to read the boxes, one image at a time. 480p is taken where there are several
sizes; other data sets with masks in this layout, without a folder of sizes, are read too.
"""

from __future__ import annotations

import zlib
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.formats.files import (
    Entry,
    Floats,
    dataset_name,
    files_with,
    images_in,
    subfolders,
    track,
    track_name,
)
from re3.data.picture_size import check_size
from re3.data.sequence import Sequence

LAYOUT = "JPEGImages/480p/<sequence>/ and Annotations/480p/<sequence>/ with a .png a frame"

_SIZE = "480p"
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3
"""Kinds of PNG, in its header."""


def detect(folder: Path) -> bool:
    """Whether there are `JPEGImages` and `Annotations` with a folder of PNG images."""
    return any(files_with(path, ".png") for path in _clips(folder))


def entries(folder: Path, *, merge: bool = False) -> list[Entry]:
    """The clips that have masks."""
    dataset = dataset_name(folder)
    return [
        Entry(
            masks.name,
            partial(_read, masks, _frames_of(folder, masks), dataset, merge),
        )
        for masks in _clips(folder)
    ]


def read_mask(path: Path) -> NDArray[np.uint8]:
    """The ids of a mask, `[H, W]`: palette indices, or grey values.

    Raises:
        ValueError: not a PNG that can be read, or one in full colour.
    """
    data = path.read_bytes()
    if not data.startswith(_SIGNATURE):
        raise ValueError(f"{path} is not a PNG image; expected a mask")
    kind = data[25] if len(data) > 25 else None
    flag = cv2.IMREAD_GRAYSCALE if kind == _GREY else cv2.IMREAD_COLOR
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    if image is None:
        raise ValueError(f"{path} cannot be read as an image; expected a mask: restore it")
    if kind == _GREY:
        return image
    if kind != _PALETTE:
        raise ValueError(f"{path} is in full colour; expected a mask with a palette or in grey")
    # OpenCV gives the colours; the palette says which index each is.
    palette = _palette(data, path).astype(np.int32)
    colours = palette @ [1 << 16, 1 << 8, 1]
    known, first = np.unique(colours, return_index=True)
    packed = image.astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32)
    at = np.minimum(np.searchsorted(known, packed), len(known) - 1)
    if not np.array_equal(known[at], packed):
        raise ValueError(f"{path} has colours that its palette lacks; expected a mask: restore it")
    ids: NDArray[np.uint8] = first[at].astype(np.uint8)
    return ids


def _palette(data: bytes, path: Path) -> NDArray[np.uint8]:
    """RGB colours `[N, 3]` of a PNG."""
    at = len(_SIGNATURE)
    while at + 8 <= len(data):
        length = int.from_bytes(data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"PLTE":
            if zlib.crc32(kind + body) != int.from_bytes(data[at + 8 + length : at + 12 + length]):
                break
            return np.frombuffer(body, np.uint8).reshape(-1, 3)
        at += 12 + length
    raise ValueError(f"{path} has no intact palette; expected a mask: restore it")


def _sized(folder: Path) -> Path:
    """The folder of the clips: that of 480p, or of the only size, or the folder itself."""
    if (folder / _SIZE).is_dir():
        return folder / _SIZE
    sizes = [path for path in subfolders(folder) if subfolders(path)]
    return sizes[0] if sizes else folder


def _clips(folder: Path) -> list[Path]:
    if not (folder / "JPEGImages").is_dir():
        return []
    return subfolders(_sized(folder / "Annotations"))


def _frames_of(folder: Path, masks: Path) -> Path:
    return folder / "JPEGImages" / masks.relative_to(folder / "Annotations")


def _read(masks: Path, source: Path, dataset: str, merge: bool) -> list[Sequence]:
    images = images_in(source)
    index = {path.stem: t for t, path in enumerate(images)}
    paths = files_with(masks, ".png")
    if len(paths) not in (1, len(index)):
        raise ValueError(
            f"{masks} has {len(paths)} masks, but {source} {len(index)} images; expected one a "
            "frame, or that of the first alone"
        )
    boxes: dict[int, dict[int, Floats]] = {}
    for path in paths:
        if path.stem not in index:
            raise ValueError(f"{path}: {source} has no image {path.stem}; expected one")
        ids = read_mask(path)
        if path is paths[0]:
            check_size(images[index[path.stem]], (ids.shape[1], ids.shape[0]), path)
        if merge:
            ids = (ids > 0).astype(np.uint8)
        for key in np.flatnonzero(np.bincount(ids.ravel())):
            if key:
                boxes.setdefault(int(key), {})[index[path.stem]] = _box_around(ids == key)
    if not boxes:
        raise ValueError(f"{masks}: no mask has an object; expected pixels above 0")
    return [
        Sequence(
            name=track_name(masks.name, key, len(boxes)),
            source=source,
            dataset=dataset,
            **track(boxes[key]),
        )
        for key in sorted(boxes)
    ]


def _box_around(pixels: NDArray[np.bool_]) -> Floats:
    """The box_xywh around the pixels that are set, at least one."""
    columns, rows = np.flatnonzero(pixels.any(axis=0)), np.flatnonzero(pixels.any(axis=1))
    low, high = np.array([columns[0], rows[0]]), np.array([columns[-1], rows[-1]])
    return np.concatenate([low, high - low + 1]).astype(np.float64)
