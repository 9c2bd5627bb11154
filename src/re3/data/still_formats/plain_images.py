"""Images that nothing is known about: any patch of one may play the object.

All images of the folder and the folders below are taken, and patches drawn anew for every clip.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from re3.data.formats.files import dataset_name
from re3.data.still_formats.picture import Picture, PictureEntry, boxes_array
from re3.data.stills import Still
from re3.video.images import sorted_images

LAYOUT = "images, of which random patches are taken for objects"


def detect(folder: Path) -> bool:
    """Whether there is an image in the folder or below it."""
    return next(_images(folder), None) is not None


def entries(folder: Path) -> list[PictureEntry]:
    """Every image, without any object."""
    dataset = dataset_name(folder)
    return [
        PictureEntry(
            str(image.relative_to(folder)),
            partial(Picture, image, boxes_array([]), (), dataset=dataset),
        )
        for image in _images(folder)
    ]


def still(picture: Picture, smallest_share: float) -> Still:
    """The picture; patches cover `smallest_share` of it or more."""
    return Still(
        picture.image,
        picture.boxes_xywh,
        (),
        dataset=picture.dataset,
        smallest_share=smallest_share,
    )


def _images(folder: Path) -> Iterator[Path]:
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from sorted_images(Path(root) / name for name in names)
