"""Files in other programs' layouts with random weights, what those compute, and how they track.

The computations use the file's arrays and nothing of re3.
"""

from __future__ import annotations

import struct
from itertools import pairwise

import cv2
import numpy as np
import torch
from torch.nn import functional as F

LARGE_SHAPES = {
    "conv.0": (96, 3, 11, 11),
    "conv.1": (256, 48, 5, 5),
    "conv.2": (384, 256, 3, 3),
    "conv.3": (384, 192, 3, 3),
    "conv.4": (256, 192, 3, 3),
    "conv_skip.0": (16, 96, 1, 1),
    "conv_skip.1": (32, 256, 1, 1),
    "conv_skip.2": (64, 256, 1, 1),
    "prelu_skip.0": (16,),
    "prelu_skip.1": (32,),
    "prelu_skip.2": (64,),
    "fc6": (2048, 74208),
    "lstm1.block_input": (1024, 3072),
    "lstm1.input_gate": (1024, 4096),
    "lstm1.forget_gate": (1024, 4096),
    "lstm1.output_gate": (1024, 4096),
    "lstm2.block_input": (1024, 4096),
    "lstm2.input_gate": (1024, 5120),
    "lstm2.forget_gate": (1024, 5120),
    "lstm2.output_gate": (1024, 5120),
    "fc_output_out": (4, 1024),
}
"""Module -> shape of its weight, in the authors' large network; a bias each, but for PReLU."""

SMALL_SHAPES = {
    "feature_extractor.0.conv": (32, 3, 7, 7),
    "feature_extractor.1.conv": (64, 32, 3, 3),
    "feature_extractor.3.conv": (128, 64, 3, 3),
    "feature_extractor.5.conv": (256, 128, 3, 3),
    "feature_extractor.7.conv": (512, 256, 3, 3),
    "fc6": (2048, 50176),
    "fc_output.0": (512, 512),
    "fc_output.2": (4, 512),
}
"""The same of the small network, without normalisation and LSTM."""


def large_shapes(fully_connected=2048, units=1024):
    """Name -> shape of every tensor of the large network, or of one with fewer units."""
    sizes = {2048: fully_connected, 1024: units, 74208: 74208}
    sizes[3072] = fully_connected + units  # x and the output of before
    sizes[4096] = fully_connected + 2 * units  # and the cell; or lstm1's output in its place
    sizes[5120] = fully_connected + 3 * units
    shapes = {}
    for name, shape in LARGE_SHAPES.items():
        if not name.startswith(("conv", "prelu")):
            shape = tuple(sizes.get(side, side) for side in shape)
        shapes[f"{name}.weight"] = shape
        if not name.startswith("prelu"):
            shapes[f"{name}.bias"] = shape[:1]
    return shapes


def small_shapes(fully_connected=2048, units=512):
    """Name -> shape of every tensor of the small network, or of one with fewer units."""
    shapes = {}
    for name, shape in SMALL_SHAPES.items():
        if name.startswith("fc6"):
            shape = (fully_connected, shape[1])
        if name.startswith("fc_output"):
            shape = (units if shape[0] == 512 else 4, units)
        shapes |= {f"{name}.weight": shape, f"{name}.bias": shape[:1]}
        if name.endswith(".conv"):
            norm = name.replace(".conv", ".bn")
            shapes |= {f"{norm}.weight": shape[:1], f"{norm}.bias": shape[:1]}
    for cell, inputs in (("lstm1", fully_connected), ("lstm2", fully_connected + units)):
        shapes |= {
            f"{cell}.weight_ih": (4 * units, inputs),
            f"{cell}.weight_hh": (4 * units, units),
            f"{cell}.bias_ih": (4 * units,),
            f"{cell}.bias_hh": (4 * units,),
        }
    return shapes


def random_arrays(shapes, seed=0):
    """float32 arrays that keep signals of about one: no gate saturates, every weight counts."""
    rng = np.random.default_rng(seed)
    arrays = {}
    for name, shape in shapes.items():
        fan_in = int(np.prod(shape[1:])) if len(shape) > 1 else 1
        scale = 0.1 if len(shape) == 1 else fan_in**-0.5
        if name == "fc6.weight" and "conv.0.weight" in shapes:
            scale /= 300  # pixels are large, and so are the maps
        if name in ("fc_output_out.weight", "fc_output.2.weight"):
            scale *= 3  # so that boxes move
        arrays[name] = (scale * rng.standard_normal(shape)).astype(np.float32)
    # An object that stays gives 2.5, 2.5, 7.5, 7.5; let these be near it.
    for name in ("fc_output_out.bias", "fc_output.2.bias"):
        if name in arrays:
            arrays[name] += np.float32([2.5, 2.5, 7.5, 7.5])
    return arrays


def save_torch(arrays, path, *, old_form=False):
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    torch.save(tensors, path, _use_new_zipfile_serialization=not old_form)


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


def planes(crops):
    """uint8 `[N, S, S, 3]` BGR to float32 `[N, 3, S, S]` RGB."""
    return np.ascontiguousarray(crops[..., ::-1].transpose(0, 3, 1, 2)).astype(np.float32)


def convolve(x, w, name, **options):
    weight, bias = (torch.from_numpy(w[f"{name}.{part}"]) for part in ("weight", "bias"))
    return F.conv2d(torch.from_numpy(np.ascontiguousarray(x)), weight, bias, **options).numpy()


def pool(x, side, stride):
    return F.max_pool2d(torch.from_numpy(np.ascontiguousarray(x)), side, stride).numpy()


def relu(x):
    return np.maximum(x, 0)


def elu(x):
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


def response_norm(x):
    squares = np.pad(x**2, ((0, 0), (2, 2), (0, 0), (0, 0)))
    total = sum(squares[:, i : i + x.shape[1]] for i in range(5))
    return x / (1 + 1e-4 / 5 * total) ** 0.75


def group_norm(x, w, name):
    groups = x.reshape(len(x), 32, -1)
    mean, variance = groups.mean(axis=2, keepdims=True), groups.var(axis=2, keepdims=True)
    x = ((groups - mean) / np.sqrt(variance + 1e-5)).reshape(x.shape)
    return x * w[f"{name}.weight"][:, None, None] + w[f"{name}.bias"][:, None, None]


def linear(x, w, name):
    return x @ w[f"{name}.weight"].T + w[f"{name}.bias"]


def large_features(w, crops):
    x = planes(crops) - np.float32([123.151630838, 115.902882574, 103.062623801])[:, None, None]
    norm1 = response_norm(relu(pool(convolve(x, w, "conv.0", stride=4), 3, 2)))
    norm2 = response_norm(relu(pool(convolve(norm1, w, "conv.1", padding=2, groups=2), 3, 2)))
    conv3 = relu(convolve(norm2, w, "conv.2", padding=1))
    conv4 = relu(convolve(conv3, w, "conv.3", padding=1, groups=2))
    conv5 = relu(convolve(conv4, w, "conv.4", padding=1, groups=2))
    parts = []
    for index, tap in enumerate((norm1, norm2, conv5)):
        skip = convolve(tap, w, f"conv_skip.{index}")
        slope = w[f"prelu_skip.{index}.weight"][:, None, None]
        parts.append(np.where(skip > 0, skip, slope * skip))
    parts.append(pool(conv5, 3, 2))
    return np.concatenate([part.reshape(len(crops), -1) for part in parts], axis=1)


def large_cell(w, name, x, y, c):
    z = np.tanh(linear(np.concatenate([x, y], 1), w, f"{name}.block_input"))
    i, f = (
        sigmoid(linear(np.concatenate([x, y, c], 1), w, f"{name}.{gate}"))
        for gate in ("input_gate", "forget_gate")
    )
    c = i * z + f * c
    o = sigmoid(linear(np.concatenate([x, y, c], 1), w, f"{name}.output_gate"))
    return o * np.tanh(c), c


def large_step(w, previous, current, state):
    """Corners `[N, 4]` and the new state y1, c1, y2, c2."""
    both = np.concatenate([large_features(w, previous), large_features(w, current)], axis=1)
    features = relu(linear(both, w, "fc6"))
    first = large_cell(w, "lstm1", features, *state[:2])
    second = large_cell(w, "lstm2", np.concatenate([features, first[0]], axis=1), *state[2:])
    return linear(second[0], w, "fc_output_out"), (*first, *second)


def small_features(w, crops):
    mean, std = np.float32([[123.675, 116.28, 103.53], [58.395, 57.12, 57.375]])[..., None, None]
    x = (planes(crops) - mean) / std
    for block in (0, 1, 3, 5, 7):
        if block >= 3:
            x = pool(x, 2, 2)
        options = {"padding": 1} if block else {"padding": 3, "stride": 4}
        x = convolve(x, w, f"feature_extractor.{block}.conv", **options)
        x = elu(group_norm(x, w, f"feature_extractor.{block}.bn"))
    return x.reshape(len(crops), -1)


def small_cell(w, name, x, y, c):
    gates = x @ w[f"{name}.weight_ih"].T + w[f"{name}.bias_ih"]
    gates = gates + y @ w[f"{name}.weight_hh"].T + w[f"{name}.bias_hh"]
    i, f, g, o = np.split(gates, 4, axis=1)
    c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
    return sigmoid(o) * np.tanh(c), c


def small_step(w, previous, current, state):
    """Corners `[N, 4]` and the new state y1, c1, y2, c2."""
    both = np.concatenate([small_features(w, previous), small_features(w, current)], axis=1)
    features = elu(linear(both, w, "fc6"))
    first = small_cell(w, "lstm1", features, *state[:2])
    second = small_cell(w, "lstm2", np.concatenate([features, first[0]], axis=1), *state[2:])
    readout = elu(linear(second[0], w, "fc_output.0"))
    return linear(readout, w, "fc_output.2"), (*first, *second)


def cut_out(image, region):
    """The crop of a region, and nothing but black where it reaches over the frame's border."""
    left, top, right, bottom = (int(value) for value in np.round(region))
    height, width = image.shape[:2]
    seen = image[max(top, 0) : min(bottom, height), max(left, 0) : min(right, width)]
    if seen.size == 0:
        return np.zeros((1, 227, 227, 3), np.uint8)
    rows = max(1, int(np.round(227 * seen.shape[0] / (bottom - top))))
    columns = max(1, int(np.round(227 * seen.shape[1] / (right - left))))
    above = int(max(0, -top * 227 / (bottom - top)))
    before = int(max(0, -left * 227 / (right - left)))
    around = ((above, 227 - above - rows), (before, 227 - before - columns), (0, 0))
    return np.pad(cv2.resize(seen, (columns, rows)), around)[None]


def around(box):
    """The region about a box_xyxy: twice as wide and high."""
    x1, y1, x2, y2 = box
    x, y, w, h = (x1 + x2) / 2, (y1 + y2) / 2, x2 - x1, y2 - y1
    return np.array([x - w, y - h, x + w, y + h])


def drift(step, zeros, frames, box_xyxy):
    """What to add to corners, so that the box of random weights stays about where it is."""
    state, seen = zeros, []
    for image in frames[:12]:
        crop = cut_out(image, around(box_xyxy))
        corners, state = step(crop, crop, state)
        seen.append(corners[0])
    return np.float32([2.5, 2.5, 7.5, 7.5]) - np.mean(seen[4:], axis=0)


def follow(step, zeros, frames, box_xyxy, interval):
    """The authors' tracker, step by step: boxes_xyxy of all frames after the first.

    `step` takes the crops of the previous and the current frame and a state, and gives corners and
    the next state.
    """
    box = np.asarray(box_xyxy, dtype=np.float64)
    crop = cut_out(frames[0], around(box))
    _, first = step(crop, crop, zeros)
    state, boxes = first, []
    for index, (before, image) in enumerate(pairwise(frames), start=1):
        left, top, right, bottom = region = around(box)
        corners, state = step(cut_out(before, region), cut_out(image, region), state)
        unit = np.array([right - left, bottom - top] * 2)
        box = corners[0].astype(np.float64) / 10 * unit + [left, top, left, top]
        boxes.append(box)
        if index % interval == 0:
            crop = cut_out(image, around(box))
            _, state = step(crop, crop, first)
    return np.array(boxes)


def varint(number):
    out = bytearray()
    while number >= 0x80:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])


def message(*fields):
    """A protobuf message of (number, int or bytes or text)."""
    out = b""
    for number, value in fields:
        if isinstance(value, int):
            out += varint(number << 3) + varint(value)
        else:
            value = value.encode() if isinstance(value, str) else value
            out += varint(number << 3 | 2) + varint(len(value)) + value
    return out


def blob(array, *, old=False, double=False):
    """A BlobProto: its shape in the old or the new form, its values."""
    if old:
        sides = (1,) * (4 - array.ndim) + array.shape
        shape = [(number, int(side)) for number, side in enumerate(sides, start=1)]
    else:
        shape = [(7, message((1, b"".join(varint(side) for side in array.shape))))]
    values = array.astype("<f8" if double else "<f4").tobytes()
    return message(*shape, (8 if double else 5, values))


def caffe_layer(name, blobs=(), *, old=False, **options):
    """A layer as a field of the net."""
    if old:
        return 2, message((4, name), (5, 4), *((6, blob(b, old=True, **options)) for b in blobs))
    return 100, message((1, name), (2, "Any"), *((7, blob(b, **options)) for b in blobs))


def caffemodel(layers, *, name="made", **options):
    """A net of (layer's name, its arrays)."""
    fields = [caffe_layer(layer, blobs, **options) for layer, blobs in layers]
    return message((1, name), *fields)


def unpacked_floats(array):
    """A BlobProto whose values are a field each."""
    shape = (7, message((1, b"".join(varint(side) for side in array.shape))))
    values = b"".join(varint(5 << 3 | 5) + struct.pack("<f", value) for value in array.ravel())
    return message(shape) + values
