"""PASCAL VOC: `JPEGImages/*.jpg`, `Annotations/*.xml` and, of some, `SegmentationObject/*.png`.

Everingham et al.: The PASCAL visual object classes challenge, IJCV 2010. Corners are 1-based, both
inclusive. The palette index of `SegmentationObject` is the number of the object in the XML file,
counted from 1; 255 is the border between objects. Objects marked difficult or truncated are read.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import cv2

from re3.data.formats.files import dataset_name, files_with, images_in
from re3.data.masks import IndexedMask, Mask
from re3.data.stills import Still, make_still

LAYOUT = "JPEGImages/ and Annotations/ with an .xml an image"

_EXPECTED = "<size> with width and height and <object> with bndbox (xmin, ymin, xmax, ymax)"


def detect(folder: Path) -> bool:
    """Whether there are `JPEGImages` and XML files in `Annotations`."""
    return (folder / "JPEGImages").is_dir() and bool(files_with(folder / "Annotations", ".xml"))


def read(folder: Path, smallest_share: float) -> list[Still]:
    """The pictures that have an XML file."""
    images = {path.stem: path for path in images_in(folder / "JPEGImages")}
    stills = []
    for text in files_with(folder / "Annotations", ".xml"):
        if text.stem not in images:
            raise FileNotFoundError(
                f"{folder / 'JPEGImages'} has no image {text.stem}; expected that of {text}"
            )
        size, boxes = read_xml(text, images[text.stem], first_pixel=1)
        outlines = folder / "SegmentationObject" / f"{text.stem}.png"
        masks: list[Mask | None] = [None] * len(boxes)
        if outlines.is_file():
            masks = [IndexedMask(outlines, number) for number in range(1, len(boxes) + 1)]
        still = make_still(
            images[text.stem],
            boxes,
            size[0] * size[1],
            smallest_share,
            masks=masks,
            dataset=dataset_name(folder),
        )
        if still is not None:
            stills.append(still)
    return stills


def read_xml(
    text: Path, image: Path, *, first_pixel: int
) -> tuple[tuple[float, float], list[tuple[float, float, float, float]]]:
    """Width and height of a picture, and box_xywh of every object, without area where it has none.

    Args:
        text: the XML file.
        image: its picture, which is decoded where the file does not say how large it is.
        first_pixel: what the dataset calls the first column and row of an image, 0 or 1.

    Raises:
        ValueError: the file is not of that form, or the picture cannot be read.
    """
    try:
        root = ET.parse(text).getroot()
        size = tuple(float(root.findtext(f"size/{side}") or 0) for side in ("width", "height"))
        boxes = [_box(element, first_pixel) for element in root.findall("object")]
    except (ET.ParseError, ValueError) as error:
        raise ValueError(f"{text}: {error}; expected {_EXPECTED}") from error
    if min(size) <= 0:
        picture = cv2.imread(str(image))
        if picture is None:
            raise ValueError(f"{image} cannot be read as an image; restore it or leave it out")
        size = (float(picture.shape[1]), float(picture.shape[0]))
    return (size[0], size[1]), boxes


def _box(element: ET.Element, first_pixel: int) -> tuple[float, float, float, float]:
    corners = []
    for side in ("xmin", "ymin", "xmax", "ymax"):
        number = element.findtext(f"bndbox/{side}")
        if number is None:
            raise ValueError(f"an object has no bndbox/{side}")
        corners.append(float(number))
    left, top, right, bottom = corners
    return (left - first_pixel, top - first_pixel, right - left + 1, bottom - top + 1)
