"""Trunk features for training, without gradients.

ONNX Runtime makes those of a frozen trunk about six times faster than eager torch on a CPU. Its
threads do not spin while they wait, or they would fight torch's for the cores. Torch makes those of
a trunk that learns, and those on a GPU.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from re3.network.re3_lite import Features, Re3Lite
from re3.training.device import Device

Trunk = Callable[[NDArray[np.uint8]], Features]
"""Makes trunk maps of uint8 `[N, S, S, 3]` BGR crops."""

CHUNK = 8
"""Crops in one call: more at once run slower for each, as their maps leave the cache."""


class FrozenTrunk:
    """The trunk of a network at one crop size.

    Args:
        network: whose trunk is copied.
        size: side of the crops in pixels.
        threads: of ONNX Runtime.
    """

    def __init__(self, network: Re3Lite, size: int, threads: int) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        self.session = onnxruntime.InferenceSession(
            _to_onnx(network, size), options, providers=["CPUExecutionProvider"]
        )

    def __call__(self, crops: NDArray[np.uint8]) -> Features:
        """Trunk maps of uint8 `[N, S, S, 3]` BGR crops."""
        parts = [
            self.session.run(None, {"crops": crops[start : start + CHUNK]})
            for start in range(0, len(crops), CHUNK)
        ]
        at4, at8, at16 = (
            torch.from_numpy(np.concatenate(maps)) for maps in zip(*parts, strict=True)
        )
        return at4, at8, at16


class TorchTrunk:
    """The trunk of a network as it is at the time, run by torch.

    Args:
        network: whose trunk it is.
        device: on which the network is.
    """

    def __init__(self, network: Re3Lite, device: Device) -> None:
        self.network, self.device = network, device

    def __call__(self, crops: NDArray[np.uint8]) -> Features:
        """Trunk maps of uint8 `[N, S, S, 3]` BGR crops, in single precision, on the device."""
        with torch.no_grad(), self.device.autocast():
            on_device = torch.from_numpy(crops).to(self.device.torch)
            at4, at8, at16 = self.network.features(on_device)
        return at4.float(), at8.float(), at16.float()


class _Trunk(nn.Module):
    def __init__(self, network: Re3Lite) -> None:
        super().__init__()
        self.network = network

    def forward(self, crops: Tensor) -> Features:
        return self.network.features(crops)


def _to_onnx(network: Re3Lite, size: int) -> bytes:
    example = torch.zeros(2, size, size, 3, dtype=torch.uint8)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        path = str(Path(folder) / "trunk.onnx")
        warnings.simplefilter("ignore")  # of the tracer, about shapes that are constant here
        torch.onnx.export(
            _Trunk(network).eval(),
            (example,),
            path,
            input_names=["crops"],
            output_names=["at4", "at8", "at16"],
            dynamic_axes={name: {0: "n"} for name in ("crops", "at4", "at8", "at16")},
            opset_version=17,
            dynamo=False,
        )
        return Path(path).read_bytes()
