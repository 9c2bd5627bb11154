"""Caffe's files: both forms of layers and of shapes, and files that are none."""

import numpy as np
import pytest
from weight_files import blob, caffe_layer, caffemodel, message, unpacked_floats, varint

from re3.network.importers.caffemodel import read_caffemodel
from re3.network.importers.wire import read_fields, read_varint

rng = np.random.default_rng(0)
WEIGHT, BIAS = rng.normal(size=(4, 3, 2, 2)).astype(np.float32), np.float32([1, -2, 3, 0.5])


@pytest.mark.parametrize("number", [0, 1, 127, 128, 300, 2**32, 2**63])
def test_a_varint_survives(number):
    data = memoryview(b"\xff" + varint(number) + b"\x01")
    assert read_varint(data, 1) == (number, 1 + len(varint(number)))


def test_fields_of_every_type_are_read_in_order():
    data = message((1, 300), (2, "conv")) + b"\x1d1234" + b"\x2112345678" + message((16, 7))
    found = [(f.number, f.value if isinstance(f.value, int) else bytes(f.value))
             for f in read_fields(memoryview(data))]  # fmt: skip
    assert found == [(1, 300), (2, b"conv"), (3, b"1234"), (4, b"12345678"), (16, 7)]


@pytest.mark.parametrize(
    ("data", "bias_shape"),
    [
        (caffemodel([("relu", ()), ("conv", (WEIGHT, BIAS))]), (4,)),
        (caffemodel([("relu", ()), ("conv", (WEIGHT, BIAS))], old=True), (1, 1, 1, 4)),  # V1
        (caffemodel([("relu", ()), ("conv", (WEIGHT, BIAS))], double=True), (4,)),
        (
            message(
                (1, "made"),
                caffe_layer("relu"),
                (100, message((1, "conv"), (7, unpacked_floats(WEIGHT)), (7, blob(BIAS)))),
            ),
            (4,),
        ),
    ],
    ids=["now", "V1 with old shapes", "doubles", "a field a value"],
)
def test_layers_and_their_blobs_are_read(tmp_path, data, bias_shape):
    path = tmp_path / "net.caffemodel"
    path.write_bytes(data)
    model = read_caffemodel(path)
    assert model.name == "made"
    assert [layer.name for layer in model.layers] == ["relu", "conv"]
    assert model.layers[0].blobs == ()
    weight, bias = model.layers[1].blobs
    np.testing.assert_array_equal(weight, WEIGHT)
    np.testing.assert_array_equal(bias.ravel(), BIAS)
    assert bias.shape == bias_shape
    assert weight.dtype == np.float32


WHOLE = caffemodel([("conv", (WEIGHT, BIAS))])
SHORT_BLOB = message((7, message((1, b"\x05"))), (5, b"\0" * 16))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (WHOLE[:-5], r"field 100 at byte 6 has \d+ bytes, of which \d+ are there.*complete"),
        (b"\x80" * 12, "the number at byte 0 does not end"),
        (b"\x0b\x01", "field 1 at byte 0 is of unknown type 3"),
        (b"\x02\x01", "field number 0"),
        (message((1, "made")), "has no layers"),
        (message((100, 5)), "field 100 is the number 5; expected bytes"),
        (message((1, b"\xff\xfe")), "not UTF-8"),
        (
            message((100, message((1, "conv"), (7, SHORT_BLOB)))),
            r"layer 'conv': a blob of shape \(5,\) has 4 values",
        ),
        (
            message((100, message((1, "conv"), (7, message((5, b"123")))))),
            "layer 'conv': a blob has 3 bytes, no whole number of values",
        ),
        (message((2, message((1, message((1, "conv")))))), "first form .V0.*upgrade_net_proto"),
    ],
    ids=[
        "empty",
        "cut off",
        "endless number",
        "group",
        "field 0",
        "no layers",
        "no message",
        "no text",
        "too few values",
        "half a value",
        "V0",
    ],
)
def test_a_broken_file_is_named(tmp_path, data, message):
    path = tmp_path / "net.caffemodel"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=rf"net\.caffemodel.*{message}"):
        read_caffemodel(path)
