"""The protobuf wire format, as far as reading needs it: fields, packed numbers, text.

Source: protobuf.dev, "Encoding". A message is a row of fields, each a varint `number << 3 | type`
and a value: a varint (type 0), eight bytes (1), a length and so many bytes (2), or four bytes (5).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

VARINT, EIGHT_BYTES, BYTES, FOUR_BYTES = 0, 1, 2, 5
LONGEST_VARINT = 10
"""Bytes: 64 bits by seven."""


class Field(NamedTuple):
    """One field of a message; of type BYTES and of fixed width the value is the bytes."""

    number: int
    type: int
    value: int | memoryview


def read_varint(data: memoryview, at: int) -> tuple[int, int]:
    """The number that begins at a place, and the place after it.

    Raises:
        ValueError: the data end in it, or it does not end.
    """
    value = 0
    for index in range(LONGEST_VARINT):
        if at + index >= len(data):
            raise ValueError(f"the data end inside a number at byte {at}")
        byte = data[at + index]
        value |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            return value, at + index + 1
    raise ValueError(f"the number at byte {at} does not end")


def read_fields(data: memoryview) -> Iterator[Field]:
    """The fields of a message, in order; nothing is copied.

    Raises:
        ValueError: not such a message, or one that is cut off.
    """
    at = 0
    while at < len(data):
        start = at
        key, at = read_varint(data, at)
        number, kind = key >> 3, key & 7
        if number == 0:
            raise ValueError(f"field number 0 at byte {start}")
        if kind == VARINT:
            value, at = read_varint(data, at)
            yield Field(number, kind, value)
            continue
        if kind == BYTES:
            length, at = read_varint(data, at)
        elif kind in (EIGHT_BYTES, FOUR_BYTES):
            length = 8 if kind == EIGHT_BYTES else 4
        else:
            raise ValueError(f"field {number} at byte {start} is of unknown type {kind}")
        if at + length > len(data):
            raise ValueError(
                f"field {number} at byte {start} has {length} bytes, of which {len(data) - at} "
                "are there"
            )
        yield Field(number, kind, data[at : at + length])
        at += length


def as_bytes(field: Field) -> memoryview:
    """The bytes of a field; raises ValueError for a number."""
    if not isinstance(field.value, memoryview):
        raise ValueError(f"field {field.number} is the number {field.value}; expected bytes")
    return field.value


def as_text(field: Field) -> str:
    """UTF-8; raises ValueError for anything else."""
    try:
        return bytes(as_bytes(field)).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"field {field.number} is not UTF-8 text: {error}") from error


def as_integers(field: Field) -> list[int]:
    """The number of a field, or its numbers where they are packed into one."""
    if isinstance(field.value, int):
        return [field.value]
    numbers, at = [], 0
    while at < len(field.value):
        number, at = read_varint(field.value, at)
        numbers.append(number)
    return numbers
