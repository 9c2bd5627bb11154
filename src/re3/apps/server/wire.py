"""A message of a JSON head and bytes: between server and decoder, and from server to page.

Four bytes, the length of the head as a big-endian number; the head, a JSON object in UTF-8; the
bytes, to the message's end. In a pipe, which knows no end of a message, the head says in `bytes`
how many there are.
"""

from __future__ import annotations

import json
import struct
from typing import IO, Any

Head = dict[str, Any]
_LENGTH = struct.Struct(">I")


def packed(head: Head, payload: bytes | memoryview = b"") -> bytes:
    """The message as bytes."""
    text = json.dumps(head).encode()
    return b"".join((_LENGTH.pack(len(text)), text, payload))


def write_message(pipe: IO[bytes], head: Head, payload: bytes | memoryview = b"") -> None:
    """Send a message through a pipe; raises OSError where nobody reads it."""
    size = payload.nbytes if isinstance(payload, memoryview) else len(payload)
    text = json.dumps({**head, "bytes": size}).encode()
    pipe.write(_LENGTH.pack(len(text)))
    pipe.write(text)
    pipe.write(payload)
    pipe.flush()


def read_message(pipe: IO[bytes]) -> tuple[Head, bytearray]:
    """The next message of a pipe; raises EOFError where there is none, or only a part of one."""
    (length,) = _LENGTH.unpack(_exactly(pipe, _LENGTH.size))
    head: Head = json.loads(bytes(_exactly(pipe, length)))
    return head, _exactly(pipe, head["bytes"])


def _exactly(pipe: IO[bytes], size: int) -> bytearray:
    data = bytearray(size)
    view, filled = memoryview(data), 0
    while filled < size:
        count = pipe.readinto(view[filled:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError(f"the pipe ended after {filled} of {size} bytes")
        filled += count
    return data
