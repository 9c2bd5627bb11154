"""How large a picture is once it is decoded, told from its header where that is enough."""

from __future__ import annotations

import warnings
from pathlib import Path

import cv2
from PIL import Image

_ORIENTATION = 0x0112
_UPRIGHT = 1


class WrongSize(ValueError):
    """A picture is decoded to another size than its boxes were made for."""


def check_size(path: Path, stated: tuple[float, float] | None, stated_in: Path) -> tuple[int, int]:
    """Width and height of the decoded picture, compared with those that an annotation states.

    Args:
        path: of the picture.
        stated: width and height in pixels; None where the annotation states none.
        stated_in: the annotation, for the message.

    Raises:
        WrongSize: the two differ.
        FileNotFoundError, ValueError: as of `picture_size`.
    """
    width, height = picture_size(path)
    if stated is not None and stated != (width, height):
        turned = " (is it turned by its EXIF orientation?)" if stated == (height, width) else ""
        pixels = f"{stated[0]:g} x {stated[1]:g}"
        raise WrongSize(
            f"{path} is decoded to {width} x {height} pixels{turned}, but {stated_in} states "
            f"{pixels}, for which its boxes were made; store the picture with {pixels} pixels, or "
            "correct its size and its boxes"
        )
    return width, height


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height in pixels of a picture as `cv2.imread` decodes it.

    The picture itself is decoded only where its header has an EXIF orientation, which turns it, or
    cannot be read.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it cannot be read as an image.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; expected an image")
    try:
        with warnings.catch_warnings():
            # Of more than 89 million pixels; nothing is decoded here.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                # Without this, Pillow decodes a whole PNG image to look for one behind its pixels.
                exif = image.format != "PNG" or "exif" in image.info
                if not exif or image.getexif().get(_ORIENTATION, _UPRIGHT) == _UPRIGHT:
                    return image.size
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        pass
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise ValueError(f"{path} cannot be read as an image; restore it or leave it out")
    height, width = picture.shape[:2]
    return width, height
