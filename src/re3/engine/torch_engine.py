"""Eager torch: for development, comparison and models that have not been exported."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from re3.engine.base import StepOutput
from re3.network.variants import Network
from re3.network.weights import load_network


class TorchEngine:
    """Runs a network from its .safetensors file, or from the weights in an exported .onnx file.

    Args:
        source: path of the file, or the network itself.
        threads: of torch, for the whole process; 0 leaves them as they are.

    Raises:
        ValueError: a file that holds no weights of a known network.
    """

    def __init__(self, source: str | Path | Network, threads: int = 0) -> None:
        if threads:
            torch.set_num_threads(threads)
        network = load_network(source) if isinstance(source, str | Path) else source
        self._network = network.eval()
        self.spec = self._network.spec()

    def step(
        self,
        previous_crops: NDArray[np.uint8] | None,
        current_crops: NDArray[np.uint8],
        state: Mapping[str, NDArray[np.float32]],
    ) -> StepOutput:
        """See `re3.engine.base.Engine.step`."""
        before = self._network.zero_state(len(current_crops))
        before = type(before)(**{k: torch.from_numpy(v) for k, v in state.items()})
        crops = [previous_crops, current_crops]
        with torch.inference_mode():
            corners, score, after = self._network(
                *(torch.from_numpy(crop) for crop in crops if crop is not None), before
            )
        return StepOutput(
            corners.numpy(),
            score.numpy(),
            {name: values.numpy() for name, values in after._asdict().items()},
        )
