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

from re3.network.base import Maps, TrackingNetwork
from re3.training.device import Device

Trunk = Callable[[NDArray[np.uint8]], Maps]
"""Makes the network's maps of uint8 `[N, S, S, 3]` BGR crops, previous or current."""

CHUNK = 8
"""Crops in one call: more at once run slower for each, as their maps leave the cache."""


class FrozenTrunk:
    """The trunk of a network as it is now, for the sizes of its crops.

    Args:
        network: whose trunk is copied.
        threads: of ONNX Runtime.
    """

    def __init__(self, network: TrackingNetwork, threads: int) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        spec = network.spec()
        # Padding depends on the size: a graph each.
        self.sessions = {
            size: onnxruntime.InferenceSession(
                _to_onnx(network, size), options, providers=["CPUExecutionProvider"]
            )
            for size in {crop.size for crop in (spec.previous, spec.current) if crop is not None}
        }

    def __call__(self, crops: NDArray[np.uint8]) -> Maps:
        """Trunk maps of uint8 `[N, S, S, 3]` BGR crops."""
        session = self.sessions[crops.shape[1]]
        parts = [
            session.run(None, {"crops": crops[start : start + CHUNK]})
            for start in range(0, len(crops), CHUNK)
        ]
        return tuple(torch.from_numpy(np.concatenate(maps)) for maps in zip(*parts, strict=True))


class TorchTrunk:
    """The trunk of a network as it is at the time, run by torch.

    Args:
        network: whose trunk it is.
        device: on which the network is.
    """

    def __init__(self, network: TrackingNetwork, device: Device) -> None:
        self.network, self.device = network, device

    def __call__(self, crops: NDArray[np.uint8]) -> Maps:
        """Trunk maps of uint8 `[N, S, S, 3]` BGR crops, in single precision, on the device."""
        with torch.no_grad(), self.device.autocast():
            maps = self.network.features(torch.from_numpy(crops).to(self.device.torch))
        return tuple(one.float() for one in maps)


class _Trunk(nn.Module):
    def __init__(self, network: TrackingNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, crops: Tensor) -> Maps:
        return self.network.features(crops)


def _to_onnx(network: TrackingNetwork, size: int) -> bytes:
    example = torch.zeros(2, size, size, 3, dtype=torch.uint8)
    with torch.no_grad():
        outputs = [f"map{index}" for index in range(len(network.features(example)))]
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        path = str(Path(folder) / "trunk.onnx")
        warnings.simplefilter("ignore")  # of the tracer, about shapes that are constant here
        torch.onnx.export(
            _Trunk(network).eval(),
            (example,),
            path,
            input_names=["crops"],
            output_names=outputs,
            dynamic_axes={name: {0: "n"} for name in ("crops", *outputs)},
            opset_version=17,
            dynamo=False,
        )
        return Path(path).read_bytes()
