"""Addresses of network streams."""

from __future__ import annotations

import re

STREAM_SCHEMES = (
    "rtsp",
    "rtsps",
    "rtmp",
    "rtmps",
    "http",
    "https",
    "udp",
    "tcp",
    "srt",
    "rtp",
    "srtp",
    "tls",
    "ftp",
    "sftp",
    "mmsh",
    "mmst",
    "rist",
)
"""What is read as a stream; which of them work depends on how FFmpeg was built."""

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")


def scheme_of(text: str) -> str | None:
    """The scheme of an address such as `rtsp://host/path`, in lower case; None of a path."""
    found = _SCHEME.match(text)
    return found[1].lower() if found else None


def is_stream(text: str) -> bool:
    """Whether the text is the address of a network stream."""
    return scheme_of(text) in STREAM_SCHEMES


def without_password(location: str) -> str:
    """An address as it may be shown: user and password of a stream left out."""
    return re.sub(r"(?<=://)[^/@]*@", "", location)
