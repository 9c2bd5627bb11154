"""Images that nothing is known about: any patch of one may play the object.

All images of the folder and the folders below are taken, and patches drawn anew for every clip.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from re3.data.formats.files import dataset_name
from re3.data.stills import Still
from re3.video.images import sorted_images

LAYOUT = "images, of which random patches are taken for objects"


def detect(folder: Path) -> bool:
    """Whether there is an image in the folder or below it."""
    return next(_images(folder), None) is not None


def read(folder: Path, smallest_share: float) -> list[Still]:
    """Every image; patches cover `smallest_share` of it or more."""
    dataset = dataset_name(folder)
    return [
        Still(image, np.zeros((0, 4)), (), dataset=dataset, smallest_share=smallest_share)
        for image in _images(folder)
    ]


def _images(folder: Path) -> Iterator[Path]:
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from sorted_images(Path(root) / name for name in names)
