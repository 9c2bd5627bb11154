"""8-bit convolutions for networks like the paper's: ranges of maps come from recorded steps."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)

Feeds = Mapping[str, NDArray]
"""Inputs of one step by name, as ONNX Runtime takes them."""

FEWEST_STEPS = 10
COLOURS = 3


class _Recorded(CalibrationDataReader):
    """Steps one after the other, as ONNX Runtime's calibration asks for them."""

    def __init__(self, steps: Sequence[Feeds]) -> None:
        self._steps: Iterator[Feeds] = iter(steps)

    def get_next(self) -> Feeds | None:
        return next(self._steps, None)


def quantize_trunk(model: onnx.ModelProto, steps: Sequence[Feeds]) -> onnx.ModelProto:
    """A graph whose trunk has 8-bit convolutions, with a scale for each channel of the weights.

    Those of the first layer, which sees pixels, and of the skip connections stay fp32: they cost
    little and decide much.

    Args:
        model: with fp32 convolutions; large products may be of 8 bits already.
        steps: recorded with the same network on footage of the kind that is to be tracked.

    Raises:
        ValueError: too few steps, or no such convolution.
    """
    if len(steps) < FEWEST_STEPS:
        raise ValueError(
            f"{len(steps)} steps to find the ranges of maps from; expected {FEWEST_STEPS} or more"
        )
    kernels = {w.name: tuple(w.dims[1:]) for w in model.graph.initializer if len(w.dims) == 4}
    chosen = [
        node.name
        for node in model.graph.node
        if node.op_type == "Conv"
        and node.input[1].startswith("network.trunk.")
        and _pays(kernels.get(node.input[1]))
    ]
    if not chosen:
        raise ValueError("the graph has no convolution of a trunk to quantise")
    with TemporaryDirectory() as folder:
        before, after = str(Path(folder) / "before.onnx"), str(Path(folder) / "after.onnx")
        onnx.save(model, before)
        with _no_advice():
            quantize_static(
                before,
                after,
                _Recorded(steps),
                quant_format=QuantFormat.QDQ,
                nodes_to_quantize=chosen,
                op_types_to_quantize=["Conv"],
                per_channel=True,
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                calibrate_method=CalibrationMethod.MinMax,
            )
        return onnx.load(after)


@contextmanager
def _no_advice() -> Iterator[None]:
    """ONNX Runtime advises to prepare graphs first, which this one does not need."""
    level = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(level)


def _pays(kernel: tuple[int, ...] | None) -> bool:
    """Whether weights of these inputs a group, height and width are worth rounding."""
    return kernel is not None and kernel[0] > COLOURS and kernel[1] > 1
