"""ONNX Runtime: the default engine."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from re3.engine.base import StepOutput
from re3.engine.threads import checked_threads
from re3.model_spec import DATA_SUFFIX, SPEC_KEY, ModelSpec
from re3.per_process import PerProcess

AT_ONCE = 5
"""Objects in one run at most: the maps of more do not stay in the processor's caches."""


class OnnxEngine:
    """A one-step graph written by `re3.network.export`.

    One object is computed by all threads together. Several are dealt out, each thread with some
    for itself: threads then wait for each other once a step, not in each of its layers. Weights
    are held a second time for that, but not where they lie in a file of their own.

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
        self._path = path
        self._threads = checked_threads(threads)
        self._large = path.with_name(path.name + DATA_SUFFIX).is_file()
        try:
            self._sessions = PerProcess(lambda: self._open(self._threads))
            metadata = self._session.get_modelmeta().custom_metadata_map
        except Exception as error:  # ONNX Runtime raises classes of its own, without a base
            raise ValueError(
                f"{path} cannot be loaded as an ONNX model: {error}; "
                "is the file complete, and written by `re3 export`?"
            ) from error
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
        inputs: dict[str, NDArray[Any]] = {name: state[name] for name in names}
        inputs["current_crops"] = current_crops
        if previous_crops is not None:
            inputs["previous_crops"] = previous_crops
        outputs = ["corners", "score", *(f"new_{name}" for name in names)]
        corners, score, *new = self._run(outputs, inputs, len(current_crops))
        return StepOutput(corners, score, dict(zip(names, new, strict=True)))

    def _open(self, threads: int) -> onnxruntime.InferenceSession:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 3  # errors only; warnings concern graph clean-up
        if self._large:
            # Of a network whose weights lie apart memory counts: 7 MB less, and no slower.
            options.enable_cpu_mem_arena = options.enable_mem_pattern = False
        return onnxruntime.InferenceSession(
            str(self._path), options, providers=["CPUExecutionProvider"]
        )

    def _run(
        self, outputs: list[str], inputs: dict[str, NDArray[Any]], objects: int
    ) -> list[NDArray[np.float32]]:
        """One run of the graph, or several with a share of the objects each."""
        if objects == 1 or self._large:
            return self._session.run(outputs, inputs)
        rounds = -(-objects // (self._threads * AT_ONCE))
        shares = np.array_split(np.arange(objects), min(rounds * self._threads, objects))
        session = self._alone if len(shares) > 1 else self._session

        def run(share: NDArray[np.intp]) -> list[NDArray[np.float32]]:
            part = slice(share[0], share[-1] + 1)
            return session.run(outputs, {name: values[part] for name, values in inputs.items()})

        parts = list(map(run, shares) if self._threads == 1 else self._pools.get().map(run, shares))
        if len(parts) == 1:
            return parts[0]
        return [np.concatenate(of_all) for of_all in zip(*parts, strict=True)]

    @property
    def _session(self) -> onnxruntime.InferenceSession:
        return self._sessions.get()

    @cached_property
    def _alone(self) -> onnxruntime.InferenceSession:
        """Of one thread, the caller's: any number of threads, and processes, may run it."""
        return self._open(1)

    @cached_property
    def _pools(self) -> PerProcess[ThreadPoolExecutor]:
        return PerProcess(lambda: ThreadPoolExecutor(self._threads, thread_name_prefix="re3"))
