"""Weights of a training run as trackers that `re3 eval` runs at the speed of an exported file."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from re3.evaluation.our_tracker import OurOptions, OurTracker
from re3.evaluation.peers import TrackerInfo

WEIGHTS_SUFFIX = ".safetensors"


def with_exported_weights(infos: list[TrackerInfo], folder: Path) -> list[TrackerInfo]:
    """Trackers of which those with weights in a .safetensors file run an .onnx file.

    Boxes are the same to half a pixel (see `re3.engine.load_engine`), at a third of the time. A
    tracker with an engine of its own (`weights.safetensors@torch`) stays as it is.

    Args:
        infos: from `find_tracker`.
        folder: for the exported files.

    Raises:
        ValueError: a file that does not hold weights of a network, or torch is not installed.
    """
    return [_exported(info, folder / str(index)) for index, info in enumerate(infos)]


def _exported(info: TrackerInfo, folder: Path) -> TrackerInfo:
    made = info.factory
    if not isinstance(made, partial) or made.func is not OurTracker:
        return info
    model, options = Path(made.args[0]), made.args[1] if len(made.args) > 1 else OurOptions()
    if model.suffix.lower() != WEIGHTS_SUFFIX or options.engine != "auto":
        return info
    try:
        from re3.network.export import export_onnx
        from re3.network.weights import load_network
    except ImportError as error:
        raise ValueError(
            f"{model} holds weights, which need more than tracking does ({error}): "
            'pip install "re3[train]", or give a file that `re3 export` wrote'
        ) from error
    path = folder / f"{model.stem}.onnx"
    export_onnx(load_network(model), path, half_weights=False)
    return replace(info, factory=partial(OurTracker, str(path), options))
