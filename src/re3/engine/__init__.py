"""Engines run one network step; the recurrent state goes in and comes out."""

from __future__ import annotations

from pathlib import Path

from re3.engine.base import Engine, State, StepOutput, zero_state
from re3.models import find_weights

__all__ = ["ENGINES", "Engine", "State", "StepOutput", "load_engine", "zero_state"]

ENGINES = ("auto", "onnx", "torch")


def load_engine(model: str | Path, engine: str = "auto", threads: int = 0) -> Engine:
    """Open a model.

    Args:
        model: name of a shipped model, or path of an .onnx or .safetensors file.
        engine: "onnx", "torch", or "auto": ONNX Runtime unless the file is .safetensors.
        threads: for the engine; 0 takes one for each core.

    Raises:
        FileNotFoundError: the model's file does not exist.
        ImportError: torch is asked for but not installed.
        ValueError: unknown model or engine, or a file that the engine cannot run.
    """
    if engine not in ENGINES:
        raise ValueError(f"unknown engine {engine!r}; expected one of {', '.join(ENGINES)}")
    path = find_weights(model)
    if engine == "auto":
        engine = "torch" if path.suffix == ".safetensors" else "onnx"
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
            f"{path} holds weights only; the onnx engine expects an .onnx file: "
            "write one with `re3 export`, or take the torch engine"
        )
    from re3.engine.onnx_engine import OnnxEngine

    return OnnxEngine(path, threads)
