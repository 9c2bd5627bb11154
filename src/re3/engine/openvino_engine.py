"""OpenVINO: an engine for Intel's processors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import openvino
from numpy.typing import NDArray

from re3.engine.base import StepOutput
from re3.engine.threads import checked_threads
from re3.model_spec import SPEC_KEY, ModelSpec
from re3.per_process import PerProcess

SPEC_PLACES = ([SPEC_KEY], ["framework", SPEC_KEY])
"""Where a file keeps its `ModelSpec`: an .xml of re3's own, and metadata of an .onnx."""


class OpenVinoEngine:
    """A one-step graph written by `re3 export`, as .xml or as .onnx.

    The first step with a number of objects that was not there before takes some tens of
    milliseconds more: OpenVINO makes its programs for each shape.

    Args:
        path: of the file.
        threads: of OpenVINO; 0 takes `usable_threads()`.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not a model that OpenVINO reads, or not one of re3's.
    """

    def __init__(self, path: str | Path, threads: int = 0) -> None:
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"model file {path} does not exist")
        core = openvino.Core()
        try:
            model = core.read_model(path)
        except RuntimeError as error:
            raise ValueError(
                f"{path} cannot be loaded by OpenVINO: {error}; is the file complete, with its "
                ".bin beside an .xml, and written by `re3 export`?"
            ) from error
        place = next((place for place in SPEC_PLACES if model.has_rt_info(place)), None)
        if place is None:
            raise ValueError(
                f"{path} is a model, but carries no re3 description ({SPEC_KEY!r}); "
                "expected a file written by `re3 export`"
            )
        self.spec = ModelSpec.from_json(str(model.get_rt_info(place).value))
        settings = {
            "PERFORMANCE_HINT": "LATENCY",
            "INFERENCE_NUM_THREADS": checked_threads(threads),
            "INFERENCE_PRECISION_HINT": "f32",  # for what is not in eight bits; it may take bf16
        }
        self._requests = PerProcess(lambda: _request(path, settings))
        self._requests.get()

    def step(
        self,
        previous_crops: NDArray[np.uint8] | None,
        current_crops: NDArray[np.uint8],
        state: Mapping[str, NDArray[np.float32]],
    ) -> StepOutput:
        """See `re3.engine.base.Engine.step`."""
        inputs = {"current_crops": current_crops, **{name: state[name] for name in self.spec.state}}
        if previous_crops is not None:
            inputs["previous_crops"] = previous_crops
        found = self._requests.get().infer(inputs, share_inputs=True, share_outputs=False)
        return StepOutput(
            found["corners"],
            found["score"],
            {name: found[f"new_{name}"] for name in self.spec.state},
        )


def _request(path: Path, settings: dict[str, Any]) -> Any:
    """A compiled model, ready to be run."""
    core = openvino.Core()
    return core.compile_model(core.read_model(path), "CPU", settings).create_infer_request()
