"""Reads `.caffemodel` files, without Caffe.

A file is one protobuf message; the numbers of its fields are those of Caffe's public schema,
`src/caffe/proto/caffe.proto`. Layers are in field 100, in older files in field 2 with other numbers
inside (V1); the form before that (V0, layers inside layers) is refused.
"""

from __future__ import annotations

import math
import mmap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from re3.network.importers.wire import as_bytes, as_integers, as_text, read_fields

NET_NAME, NET_LAYERS_V1, NET_LAYERS = 1, 2, 100
LAYER_NAME, LAYER_BLOBS = 1, 7
V1_NESTED, V1_NAME, V1_BLOBS = 1, 4, 6
BLOB_OLD_SHAPE = (1, 2, 3, 4)  # num, channels, height, width
BLOB_DATA, BLOB_SHAPE, BLOB_DOUBLES = 5, 7, 8
SHAPE_SIDES = 1


@dataclass(frozen=True)
class CaffeLayer:
    """A layer of a net: float32 arrays, for a convolution `[out, in / groups, h, w]` and `[out]`.

    Attributes:
        name: such as `conv1`.
        blobs: its weights, in Caffe's order; empty where it has none.
    """

    name: str
    blobs: tuple[NDArray[np.float32], ...]


@dataclass(frozen=True)
class CaffeModel:
    """A trained net.

    Attributes:
        name: as the file says; may be empty.
        layers: in the file's order.
    """

    name: str
    layers: tuple[CaffeLayer, ...]


def read_caffemodel(path: str | Path) -> CaffeModel:
    """Read every layer.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not such a file, or one that is cut off; the message names the file and the
            layer.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"weights file {path} does not exist")
    if path.stat().st_size == 0:
        raise ValueError(f"{path} is empty; expected a Caffe model")
    with path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    try:
        model = _read_net(memoryview(data))
    except ValueError as error:
        raise ValueError(
            f"{path} cannot be read as a Caffe model: {error}; is the file complete?"
        ) from error
    if not model.layers:
        raise ValueError(f"{path} has no layers; expected a Caffe model (.caffemodel)")
    return model


def _read_net(data: memoryview) -> CaffeModel:
    name, layers = "", []
    for field in read_fields(data):
        if field.number == NET_NAME:
            name = as_text(field)
        elif field.number == NET_LAYERS:
            layers.append(_read_layer(as_bytes(field), LAYER_NAME, LAYER_BLOBS))
        elif field.number == NET_LAYERS_V1:
            layers.append(_read_layer(as_bytes(field), V1_NAME, V1_BLOBS, V1_NESTED))
    return CaffeModel(name, tuple(layers))


def _read_layer(
    data: memoryview, name_at: int, blobs_at: int, nested_at: int | None = None
) -> CaffeLayer:
    name, blobs = "", []
    for field in read_fields(data):
        if field.number == nested_at:
            raise ValueError(
                "its layers are in Caffe's first form (V0); expected one written since 2013: "
                "convert it with Caffe's upgrade_net_proto_binary"
            )
        if field.number == name_at:
            name = as_text(field)
        elif field.number == blobs_at:
            blobs.append(as_bytes(field))
    try:
        return CaffeLayer(name, tuple(_read_blob(blob) for blob in blobs))
    except ValueError as error:
        raise ValueError(f"layer {name!r}: {error}") from error


def _read_blob(data: memoryview) -> NDArray[np.float32]:
    """The values in the shape that is written with them, of the new or the old kind."""
    old, shape = dict.fromkeys(BLOB_OLD_SHAPE, 0), None
    singles, doubles = bytearray(), bytearray()
    for field in read_fields(data):
        if field.number in old:
            (old[field.number],) = as_integers(field)
        elif field.number == BLOB_SHAPE:
            shape = [
                side
                for sides in read_fields(as_bytes(field))
                if sides.number == SHAPE_SIDES
                for side in as_integers(sides)
            ]
        elif field.number == BLOB_DATA:
            singles += as_bytes(field)
        elif field.number == BLOB_DOUBLES:
            doubles += as_bytes(field)
    values = _numbers(singles, "<f4") if singles else _numbers(doubles, "<f8")
    sides = tuple(old[number] for number in BLOB_OLD_SHAPE) if shape is None else tuple(shape)
    if math.prod(sides) != len(values):
        raise ValueError(f"a blob of shape {sides} has {len(values)} values")
    return values.astype(np.float32).reshape(sides)


def _numbers(data: bytearray, kind: str) -> NDArray[np.floating]:
    if len(data) % np.dtype(kind).itemsize:
        raise ValueError(f"a blob has {len(data)} bytes, no whole number of values")
    return np.frombuffer(data, dtype=kind)
