"""Engines run one network step; the recurrent state goes in and comes out."""

from __future__ import annotations

from pathlib import Path

from re3.engine.base import Engine, State, StepOutput, zero_state
from re3.engine.mirrored import MirroredEngine
from re3.engine.threads import checked_threads
from re3.models import find_eight_bits, find_weights, is_mirrored

__all__ = [
    "ENGINES",
    "Engine",
    "State",
    "StepOutput",
    "find_file",
    "load_engine",
    "zero_state",
]

ENGINES = ("auto", "onnx-int8", "onnx", "openvino", "torch")


def find_file(model: str | Path, engine: str = "auto") -> tuple[Path, str]:
    """The file that an engine runs of a model, and which engine "auto" stands for.

    Raises:
        FileNotFoundError: the model's file does not exist.
        ValueError: unknown model or engine, or "onnx-int8" of a model without such a file.
    """
    if engine not in ENGINES:
        raise ValueError(f"unknown engine {engine!r}; expected one of {', '.join(ENGINES)}")
    path, eight_bits = find_weights(model), find_eight_bits(model)
    if engine == "auto" and eight_bits is None:
        return path, {".safetensors": "torch", ".xml": "openvino"}.get(path.suffix, "onnx")
    if engine == "openvino":
        return eight_bits or path, engine
    if engine not in ("auto", "onnx-int8"):
        return path, engine
    if eight_bits is None:
        raise ValueError(
            f"model {str(model)!r} has no file in eight bits; write one with `re3 export --int8` "
            "and give its path with engine 'onnx', or take another engine"
        )
    return eight_bits, "onnx-int8"


def load_engine(
    model: str | Path, engine: str = "auto", threads: int = 0, *, mirror: bool | None = None
) -> Engine:
    """Open a model.

    Args:
        model: name of a shipped model, or path of an .onnx or .safetensors file.
        engine: "onnx-int8" and "onnx", ONNX Runtime in eight bits and in full precision;
            "torch", which gives the same boxes as "onnx"; "openvino", in eight bits where there
            is such a file; or "auto": the first of these that the model has files for.
        threads: for the engine; 0 takes one fewer than there are cores, 4 at most.
        mirror: look at every crop mirrored as well (`MirroredEngine`); None as the model is made.

    Raises:
        FileNotFoundError: the model's file does not exist.
        ImportError: torch or OpenVINO is asked for but not installed.
        ValueError: unknown model or engine, a file that the engine cannot run, or threads that are
            not a whole number of 0 or more.
    """
    checked_threads(threads)
    path, engine = find_file(model, engine)
    once = _open(path, engine, threads)
    by_name = is_mirrored(model)
    if not (by_name if mirror is None else mirror):
        return once
    return MirroredEngine(once, str(model) if by_name else None)


def _open(path: Path, engine: str, threads: int) -> Engine:
    if path.suffix == ".xml" and engine != "openvino":
        raise ValueError(f"{path} is for OpenVINO; take the openvino engine, or an .onnx file")
    if engine == "torch":
        try:
            from re3.engine.torch_engine import TorchEngine
        except ImportError as error:
            raise ImportError(
                f"the torch engine needs more than tracking does ({error}); "
                'pip install "re3[train]", or take the onnx engine'
            ) from error
        return TorchEngine(path, threads)
    if path.suffix == ".safetensors":
        raise ValueError(
            f"{path} holds weights only; the {engine} engine expects an exported file: "
            "write one with `re3 export`, or take the torch engine"
        )
    if engine == "openvino":
        try:
            from re3.engine.openvino_engine import OpenVinoEngine
        except ImportError as error:
            raise ImportError(
                f"the openvino engine needs OpenVINO ({error}); "
                'pip install "re3[openvino]", or take the onnx engine'
            ) from error
        return OpenVinoEngine(path, threads)
    from re3.engine.onnx_engine import OnnxEngine

    return OnnxEngine(path, threads)
