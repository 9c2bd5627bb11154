"""What a file is, by its first bytes; its name is not asked.

FFmpeg also opens lists of files and addresses (HLS, concat and others), which a stranger must not
have read: of uploads only the containers and pictures named here reach it. `re3 track` takes all of
them as well, and whatever else FFmpeg opens.
"""

from __future__ import annotations

from pathlib import Path

VIDEO = "video"
PICTURE = "picture"
HEAD_BYTES = 400

EXPECTED = (
    "a video (MP4, MOV, WebM, MKV, AVI, MPEG, FLV, OGG, WMV, GIF) or a picture "
    "(JPEG, PNG, WebP, TIFF, BMP; of several frames as well)"
)

_TS_PACKET = 188
_M2TS_PACKET = 192
_TS_SYNC = 0x47
_BEGINNINGS = {
    b"\x1a\x45\xdf\xa3": VIDEO,  # Matroska, WebM
    b"FLV\x01": VIDEO,
    b"OggS": VIDEO,
    b"\x00\x00\x01\xba": VIDEO,  # MPEG program stream
    b"\x00\x00\x01\xb3": VIDEO,  # MPEG video
    b"\x30\x26\xb2\x75\x8e\x66\xcf\x11": VIDEO,  # ASF, WMV
    b"GIF87a": VIDEO,
    b"GIF89a": VIDEO,
    b"\xff\xd8\xff": PICTURE,
    b"\x89PNG\r\n\x1a\n": PICTURE,
    b"II*\x00": PICTURE,  # TIFF
    b"MM\x00*": PICTURE,
    b"II+\x00": PICTURE,  # BigTIFF
    b"MM\x00+": PICTURE,
}
_QUICKTIME_ATOMS = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")


def kind_of(head: bytes) -> str | None:
    """`VIDEO`, `PICTURE`, or None for anything else.

    Args:
        head: the first `HEAD_BYTES` of the file, or all of it.
    """
    for beginning, kind in _BEGINNINGS.items():
        if head.startswith(beginning):
            return kind
    if head[4:8] in _QUICKTIME_ATOMS:
        return VIDEO
    if head[:4] == b"RIFF":
        return {b"AVI ": VIDEO, b"WEBP": PICTURE}.get(head[8:12])
    if head[:2] == b"BM" and head[6:10] == bytes(4):  # BMP
        return PICTURE
    if _is_transport_stream(head):
        return VIDEO
    return None


def kind_of_file(path: Path) -> str | None:
    """`kind_of` the file."""
    with path.open("rb") as file:
        return kind_of(file.read(HEAD_BYTES))


def _is_transport_stream(head: bytes) -> bool:
    """MPEG-TS; in M2TS, as camcorders write it, each packet has four bytes more in front."""
    return any(
        len(head) > first + step and head[first] == head[first + step] == _TS_SYNC
        for first, step in ((0, _TS_PACKET), (4, _M2TS_PACKET))
    )
