"""Image files: one frame, or several as in TIFF stacks, animated WebP and animated PNG."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.video.base import SourceError
from re3.video.grey_levels import GreyLevels
from re3.video.image_headers import frame_pages, has_float_pixels, is_tiff

PAGES_AT_ONCE = 16
"""Pages of a TIFF stack decoded in one call; each call walks the file from its beginning."""

SHORTEST_SECONDS = 0.01
SUBSTITUTE_SECONDS = 0.1
"""Frames of an animation that are to be shown for no longer than that are shown this long, as in
browsers."""

_AS_STORED = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH


def read_image(path: Path, levels: GreyLevels | None = None) -> NDArray[np.uint8]:
    """An image file as uint8 `[H, W, 3]` BGR.

    Args:
        path: of a file of one frame.
        levels: the scale of 16-bit pixels; None takes it from this image.

    Raises:
        SourceError: it cannot be read, has several frames, or pixels that are not integers of 8 or
            16 bits.
    """
    data = _bytes_of(path)
    if len(pages := frame_pages(data.data)) > 1:
        raise SourceError(
            f"{path} holds {len(pages)} frames; expected one in a folder or glob of images: give "
            "the file by its own path, or split it into images"
        )
    return _eight_bits(path, _decoded(path, data), levels or GreyLevels())


def read_frames(
    path: Path, levels: GreyLevels, start_frame: int = 0
) -> Iterator[tuple[NDArray[np.uint8], float | None]]:
    """Frames of an image file that has several, with the seconds each is shown.

    Args:
        path: of the file.
        levels: the scale of 16-bit pixels.
        start_frame: frames before this one are left out.

    Yields:
        uint8 `[H, W, 3]` BGR, and the seconds, None of a stack of pages.

    Raises:
        SourceError: as in `read_image`, or this OpenCV does not decode all frames of the file.
    """
    data = _bytes_of(path)
    pages = frame_pages(data.data)
    if is_tiff(data.data):
        for at in range(start_frame, len(pages), PAGES_AT_ONCE):
            wanted = pages[at : at + PAGES_AT_ONCE]
            decoded = _pages(path, data, wanted[0], wanted[-1] + 1)
            for page in wanted:
                yield _eight_bits(path, decoded[page - wanted[0]], levels), None
        return
    images, seconds = _animation(path, data, len(pages))
    for image, duration in list(zip(images, seconds, strict=True))[start_frame:]:
        yield _eight_bits(path, image, levels), duration


def frame_count(path: Path) -> int:
    """Frames in an image file, by its headers; 1 where they say nothing of several."""
    if path.stat().st_size == 0:
        return 1
    # Mapped, as only headers are read of what may be large.
    return max(1, len(frame_pages(np.memmap(path, np.uint8, "r").data)))


def _bytes_of(path: Path) -> NDArray[np.uint8]:
    try:
        # Through memory: cv2.imread cannot open every path on Windows, and prints of its own.
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise SourceError(f"{path} cannot be read as an image: {error}") from error
    if not data.size:
        raise SourceError(
            f"{path} cannot be read as an image: an empty file; restore it or leave it out"
        )
    return data


def _decoded(path: Path, data: NDArray[np.uint8]) -> NDArray[Any]:
    _refuse_floats(path, data)
    try:
        image = cv2.imdecode(data, _AS_STORED)
    except cv2.error as error:
        raise SourceError(f"{path} cannot be read as an image: {error}") from error
    if image is None:
        raise SourceError(
            f"{path} cannot be read as an image: {data.size} bytes that are no known image; "
            "restore it or leave it out"
        )
    return image


def _pages(path: Path, data: NDArray[np.uint8], first: int, end: int) -> list[NDArray[Any]]:
    _refuse_floats(path, data)
    try:
        _, images = cv2.imdecodemulti(data, _AS_STORED, range=(first, end))
    except cv2.error as error:
        raise SourceError(
            f"{path} cannot be read from page {first} on: {error}; restore it"
        ) from error
    if len(images) != end - first:
        raise SourceError(
            f"{path} is broken after page {first + len(images) - 1}: its header announces page "
            f"{end - 1}; restore it or convert it to a video"
        )
    return list(images)


def _animation(
    path: Path, data: NDArray[np.uint8], announced: int
) -> tuple[list[NDArray[Any]], list[float]]:
    """Frames of an animation and the seconds each is shown."""
    decode = getattr(cv2, "imdecodeanimation", None)  # from OpenCV 4.11 on
    try:
        found = None if decode is None else decode(data)[1]
    except cv2.error as error:
        raise SourceError(f"{path} cannot be read as an animation: {error}") from error
    images = [] if found is None else list(found.frames)
    if found is None or len(images) != announced:
        raise SourceError(
            f"{path} is an animation of {announced} frames, of which OpenCV {cv2.__version__} "
            f"reads {len(images)}; restore it if it is broken; animations need OpenCV 4.11 or "
            "later (pip install -U opencv-contrib-python-headless)"
        )
    seconds = [float(milliseconds) / 1000 for milliseconds in found.durations]
    seconds = [s if s > SHORTEST_SECONDS else SUBSTITUTE_SECONDS for s in seconds]
    return [image[..., :3] for image in images], seconds


def _eight_bits(path: Path, image: NDArray[Any], levels: GreyLevels) -> NDArray[np.uint8]:
    if image.ndim == 2:
        image = np.repeat(image[..., np.newaxis], 3, axis=2)
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    if image.dtype in (np.uint16, np.int16):
        return levels.scaled(image)
    raise _unknown_range(path, str(image.dtype))


def _refuse_floats(path: Path, data: NDArray[np.uint8]) -> None:
    # Before OpenCV, which reads some of them, and prints of its own about others.
    if has_float_pixels(data.data):
        raise _unknown_range(path, "floating point")


def _unknown_range(path: Path, kind: str) -> SourceError:
    return SourceError(
        f"{path} has pixels of type {kind}; expected integers of 8 or 16 bits: the range of values "
        "to show is not known, so scale the pixels and save them as PNG or 16-bit TIFF"
    )
