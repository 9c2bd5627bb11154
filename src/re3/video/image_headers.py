"""What headers of image files say: how many frames there are, and of what type of pixels."""

from __future__ import annotations

import struct
from collections.abc import Iterator

_REDUCED_OR_MASK = 0b101
"""Bits of a TIFF page's NewSubfileType: a thumbnail, a transparency mask."""

_NEW_SUBFILE_TYPE = 254
_SAMPLE_FORMAT = 339
_FLOAT = 3
_MAX_PAGES = 1_000_000
_BROKEN = (struct.error, OverflowError)
"""What reading past the end raises, and reading at a place that no file is long enough for."""


def frame_pages(data: memoryview) -> list[int]:
    """Numbers of the pages of an image file that are frames; thumbnails and masks are not.

    Args:
        data: the whole file.
    """
    try:
        if is_tiff(data):
            return _tiff_pages(data)
        if data[:8] == b"\x89PNG\r\n\x1a\n":
            return list(range(_png_frames(data)))
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return list(range(_webp_frames(data)))
    except _BROKEN:  # what can be decoded of it is left to OpenCV
        pass
    return [0]


def has_float_pixels(data: memoryview) -> bool:
    """Whether the first page of a TIFF file has pixels of floating point; False of other files."""
    if not is_tiff(data):
        return False
    try:
        tags = next(_tiff_directories(data), {})
    except _BROKEN:
        return False
    return tags.get(_SAMPLE_FORMAT) == _FLOAT


def is_tiff(data: memoryview) -> bool:
    """Whether the file is TIFF or BigTIFF."""
    return bytes(data[:4]) in (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")


def _tiff_pages(data: memoryview) -> list[int]:
    return [
        page
        for page, tags in enumerate(_tiff_directories(data))
        if not tags.get(_NEW_SUBFILE_TYPE, 0) & _REDUCED_OR_MASK
    ] or [0]


def _tiff_directories(data: memoryview) -> Iterator[dict[int, int]]:
    """The two tags of interest, and their values, of each page."""
    order = "<" if data[:2] == b"II" else ">"
    big = bytes(data[2:4]) in (b"+\x00", b"\x00+")
    count_form, offset_form, entry_bytes, head_at = ("Q", "Q", 20, 8) if big else ("H", "I", 12, 4)
    count_bytes, inline_bytes = struct.calcsize(count_form), struct.calcsize(offset_form)
    (at,) = struct.unpack_from(order + offset_form, data, head_at)
    seen = set[int]()
    while at and at not in seen and len(seen) < _MAX_PAGES:
        seen.add(at)
        (entries,) = struct.unpack_from(order + count_form, data, at)
        end = at + count_bytes + entries * entry_bytes
        tags = {}
        for entry in range(at + count_bytes, end, entry_bytes):
            tag, form, count = struct.unpack_from(order + "HH" + offset_form, data, entry)
            if tag not in (_NEW_SUBFILE_TYPE, _SAMPLE_FORMAT):
                continue
            value_form, size = ("I", 4) if form == 4 else ("H", 2)
            where = entry + entry_bytes - inline_bytes
            if count * size > inline_bytes:
                (where,) = struct.unpack_from(order + offset_form, data, where)
            (tags[tag],) = struct.unpack_from(order + value_form, data, where)
        yield tags
        (at,) = struct.unpack_from(order + offset_form, data, end)


def _png_frames(data: memoryview) -> int:
    at = 8
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"acTL":
            return int(struct.unpack_from(">I", data, at + 8)[0])
        if kind == b"IDAT":  # what is animated says so before
            return 1
        at += 12 + size
    return 1


def _webp_frames(data: memoryview) -> int:
    at, frames = 12, 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<4sI", data, at)
        frames += kind == b"ANMF"
        at += 8 + size + size % 2
    return max(1, frames)
