"""ImageNet detection (ILSVRC DET): `Data/DET/<split>/.../*.JPEG`, `Annotations/DET/.../*.xml`.

Russakovsky et al.: ImageNet large scale visual recognition challenge, IJCV 2015; the paper's
stills (Re3, sec. III-C). Training has folders of its own below the split. Corners are taken for
0-based pixels, both inclusive, as for ImageNet Video. Images without an XML file are left out.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from re3.data.formats.files import dataset_name, subfolders
from re3.data.still_formats.picture import Picture, PictureEntry, boxes_array
from re3.data.still_formats.voc import read_xml

LAYOUT = "Data/DET/<split>/ with images and Annotations/DET/<split>/ with an .xml an image"


def detect(folder: Path) -> bool:
    """Whether there are `Data/DET` and `Annotations/DET`."""
    return (folder / "Data" / "DET").is_dir() and (folder / "Annotations" / "DET").is_dir()


def entries(folder: Path) -> list[PictureEntry]:
    """The pictures that have an XML file, split by split."""
    annotations, data = folder / "Annotations" / "DET", folder / "Data" / "DET"
    return [
        PictureEntry(
            str(text.relative_to(annotations).with_suffix("")),
            partial(
                _read,
                text,
                (data / text.relative_to(annotations)).with_suffix(".JPEG"),
                f"{dataset_name(folder)}-{split.name}",
            ),
        )
        for split in subfolders(annotations)
        for text in _texts(split)
    ]


def _read(text: Path, image: Path, dataset: str) -> Picture:
    if not image.is_file():
        raise FileNotFoundError(f"{image} does not exist; expected the image of {text}")
    size, boxes = read_xml(text, first_pixel=0)
    return Picture(image, boxes_array(boxes), (None,) * len(boxes), size, text, dataset=dataset)


def _texts(folder: Path) -> Iterator[Path]:
    """All XML files below a folder, in the order of their paths."""
    for root, folders, names in os.walk(folder):
        folders.sort()
        yield from (Path(root) / name for name in sorted(names) if name.endswith(".xml"))
