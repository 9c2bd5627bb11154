"""What variables a TensorFlow checkpoint has, without TensorFlow.

A checkpoint (V2, a "tensor bundle") is a file `.index`, and files `.data-...` with the values. The
index is a table in LevelDB's format whose keys are the names and whose values are protobuf
messages, `BundleEntryProto` of TensorFlow's public `tensor_bundle.proto`.
Source: LevelDB, "doc/table_format.md".
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from re3.network.importers.wire import as_bytes, as_integers, read_fields, read_varint

INDEX_SUFFIX = ".index"
MAGIC = bytes.fromhex("57fb808b247547db")
FOOTER_BYTES = 48
"""Two places of blocks, padded, and the magic number."""

RESTART_BYTES = 4
NOT_COMPRESSED = 0
ENTRY_SHAPE, SHAPE_SIDE, SIDE_SIZE = 2, 2, 1


def read_shapes(path: str | Path) -> dict[str, tuple[int, ...]]:
    """Name -> shape of every variable.

    Args:
        path: the `.index` file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not such a file, or one that is cut off or compressed.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"checkpoint index {path} does not exist")
    data = memoryview(path.read_bytes())
    try:
        if bytes(data[-len(MAGIC) :]) != MAGIC:
            raise ValueError("it does not end as one")
        footer = data[-FOOTER_BYTES:]
        _, _, at = _place(footer, 0)  # of the index of meta blocks, of which there are none
        start, length, _ = _place(footer, at)
        shapes = {}
        for _, place in _entries(_block(data, start, length)):
            start, length, _ = _place(place, 0)
            for name, entry in _entries(_block(data, start, length)):
                if name:  # the entry without a name is a header
                    shapes[name.decode("utf-8")] = _shape(entry)
    except ValueError as error:
        raise ValueError(
            f"{path} cannot be read as the index of a TensorFlow checkpoint: {error}"
        ) from error
    return shapes


def _place(data: memoryview, at: int) -> tuple[int, int, int]:
    """Start and length of a block, and where the next place is written."""
    start, at = read_varint(data, at)
    length, at = read_varint(data, at)
    return start, length, at


def _block(data: memoryview, start: int, length: int) -> memoryview:
    """The entries of a block, without the list of places at which keys are written out in full."""
    if start + length + 1 > len(data):
        raise ValueError(f"the block at byte {start} has {length} bytes, more than are there")
    if data[start + length] != NOT_COMPRESSED:
        raise ValueError(f"the block at byte {start} is compressed, which TensorFlow does not do")
    block = data[start : start + length]
    restarts = int.from_bytes(block[-RESTART_BYTES:], "little")
    end = len(block) - RESTART_BYTES * (restarts + 1)
    if end < 0:
        raise ValueError(f"the block at byte {start} has {restarts} restarts in {length} bytes")
    return block[:end]


def _entries(block: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Keys and values; a key is written as what differs from the one before."""
    key, at = b"", 0
    while at < len(block):
        shared, at = read_varint(block, at)
        own, at = read_varint(block, at)
        length, at = read_varint(block, at)
        if shared > len(key) or at + own + length > len(block):
            raise ValueError("a block has an entry that reaches over its end")
        key = key[:shared] + bytes(block[at : at + own])
        yield key, block[at + own : at + own + length]
        at += own + length


def _shape(entry: memoryview) -> tuple[int, ...]:
    sides = []
    for field in read_fields(entry):
        if field.number == ENTRY_SHAPE:
            for side in read_fields(as_bytes(field)):
                if side.number == SHAPE_SIDE:
                    sizes = [
                        as_integers(size)[0]
                        for size in read_fields(as_bytes(side))
                        if size.number == SIDE_SIZE
                    ]
                    sides.append(sizes[0] if sizes else 0)  # protobuf leaves out zeros
    return tuple(sides)
