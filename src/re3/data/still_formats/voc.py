"""PASCAL VOC: `JPEGImages/*.jpg`, `Annotations/*.xml` and, of some, `SegmentationObject/*.png`.

Everingham et al.: The PASCAL visual object classes challenge, IJCV 2010. Corners are 1-based, both
inclusive. The palette index of `SegmentationObject` is the number of the object in the XML file,
counted from 1; 255 is the border between objects. Objects marked difficult or truncated are read.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path

from re3.data.formats.files import dataset_name, files_with, images_in
from re3.data.masks import IndexedMask, Mask
from re3.data.still_formats.picture import Picture, PictureEntry, boxes_array

LAYOUT = "JPEGImages/ and Annotations/ with an .xml an image"

_EXPECTED = "<size> with width and height and <object> with bndbox (xmin, ymin, xmax, ymax)"


def detect(folder: Path) -> bool:
    """Whether there are `JPEGImages` and XML files in `Annotations`."""
    return (folder / "JPEGImages").is_dir() and bool(files_with(folder / "Annotations", ".xml"))


def entries(folder: Path) -> list[PictureEntry]:
    """The pictures that have an XML file."""
    images = {path.stem: path for path in images_in(folder / "JPEGImages")}
    return [
        PictureEntry(text.stem, partial(_read, folder, text, images.get(text.stem)))
        for text in files_with(folder / "Annotations", ".xml")
    ]


def _read(folder: Path, text: Path, image: Path | None) -> Picture:
    if image is None:
        raise FileNotFoundError(
            f"{folder / 'JPEGImages'} has no image {text.stem}; expected that of {text}"
        )
    size, boxes = read_xml(text, first_pixel=1)
    outlines = folder / "SegmentationObject" / f"{text.stem}.png"
    masks: list[Mask | None] = [None] * len(boxes)
    if outlines.is_file():
        masks = [IndexedMask(outlines, number) for number in range(1, len(boxes) + 1)]
    return Picture(
        image, boxes_array(boxes), tuple(masks), size, text, dataset=dataset_name(folder)
    )


def read_xml(
    text: Path, *, first_pixel: int
) -> tuple[tuple[float, float] | None, list[tuple[float, float, float, float]]]:
    """Width and height that an XML file states of its picture, and box_xywh of every object.

    Args:
        text: the XML file.
        first_pixel: what the dataset calls the first column and row of an image, 0 or 1.

    Returns:
        the size, None where the file states none; the boxes, without area where an object has
        none.

    Raises:
        ValueError: the file is not of that form.
    """
    try:
        root = ET.parse(text).getroot()
        width, height = (float(root.findtext(f"size/{side}") or 0) for side in ("width", "height"))
        boxes = [_box(element, first_pixel) for element in root.findall("object")]
    except (ET.ParseError, ValueError) as error:
        raise ValueError(f"{text}: {error}; expected {_EXPECTED}") from error
    return (width, height) if min(width, height) > 0 else None, boxes


def _box(element: ET.Element, first_pixel: int) -> tuple[float, float, float, float]:
    corners = []
    for side in ("xmin", "ymin", "xmax", "ymax"):
        number = element.findtext(f"bndbox/{side}")
        if number is None:
            raise ValueError(f"an object has no bndbox/{side}")
        corners.append(float(number))
    left, top, right, bottom = corners
    return (left - first_pixel, top - first_pixel, right - left + 1, bottom - top + 1)
