"""ONNX Runtime: the default engine."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from re3.engine.base import StepOutput
from re3.engine.threads import usable_threads
from re3.model_spec import DATA_SUFFIX, SPEC_KEY, ModelSpec


class OnnxEngine:
    """A one-step graph written by `re3.network.export`.

    Args:
        path: of the .onnx file.
        threads: of ONNX Runtime; 0 takes `usable_threads()`.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not an ONNX file, or not one of re3's.
    """

    def __init__(self, path: str | Path, threads: int = 0) -> None:
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"model file {path} does not exist")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or usable_threads()
        options.log_severity_level = 3  # errors only; warnings concern graph clean-up
        if path.with_name(path.name + DATA_SUFFIX).is_file():
            # Of a network whose weights lie apart memory counts: 7 MB less, and no slower.
            options.enable_cpu_mem_arena = options.enable_mem_pattern = False
        try:
            self._session = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # ONNX Runtime raises classes of its own, without a base
            raise ValueError(
                f"{path} cannot be loaded as an ONNX model: {error}; "
                "is the file complete, and written by `re3 export`?"
            ) from error
        metadata = self._session.get_modelmeta().custom_metadata_map
        if SPEC_KEY not in metadata:
            raise ValueError(
                f"{path} is an ONNX model, but carries no re3 description ({SPEC_KEY!r}); "
                "expected a file written by `re3 export`"
            )
        self.spec = ModelSpec.from_json(metadata[SPEC_KEY])

    def step(
        self,
        previous_crops: NDArray[np.uint8] | None,
        current_crops: NDArray[np.uint8],
        state: Mapping[str, NDArray[np.float32]],
    ) -> StepOutput:
        """See `re3.engine.base.Engine.step`."""
        names = list(self.spec.state)
        inputs = {"current_crops": current_crops, **{name: state[name] for name in names}}
        if previous_crops is not None:
            inputs["previous_crops"] = previous_crops
        corners, score, *new = self._session.run(
            ["corners", "score", *(f"new_{name}" for name in names)],
            inputs,
        )
        return StepOutput(corners, score, dict(zip(names, new, strict=True)))
