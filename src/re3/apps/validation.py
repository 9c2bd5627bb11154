"""Validation during training: the tracker as it ships, on a fixed choice of annotated clips."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from re3.data.formats import read_dataset
from re3.data.sequence import Sequence
from re3.evaluation.ablation import ABLATION, ablation
from re3.evaluation.one_pass import TrackerFactory, run_one_pass
from re3.evaluation.peers import find_tracker
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.supervised import run_supervised

if TYPE_CHECKING:
    from re3.network.base import StepNetwork


class Validation:
    """Success AUC of one pass, and drops with the tracker started again after each (Re3, Table I).

    Args:
        folder: with annotated clips.
        clips: at most so many of them, evenly taken from all; None takes all.

    Raises:
        ValueError: no clips there, or `clips` is below 1.
    """

    def __init__(self, folder: Path, clips: int | None = None) -> None:
        self.sequences = clips_of(folder, clips)

    def __call__(self, network: StepNetwork) -> dict[str, float]:
        """`AUC`, mean over the clips, then `drops`, `accuracy` and `robustness` of Table I."""
        from re3.network.export import export_onnx

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "network.onnx"
            export_onnx(network, path)
            factory = find_tracker(str(path)).factory
            if factory is None:
                raise ValueError(f"{path} cannot be run for validation")
            return figures(factory, self.sequences)


def figures(factory: TrackerFactory, sequences: list[Sequence]) -> dict[str, float]:
    """What validation says of a tracker; the first figure decides which weights are best."""
    passes = [SequenceResult.of("", s, run_one_pass(factory, s)) for s in sequences]
    restarts = [SequenceResult.of("", s, run_supervised(factory, s, ABLATION)) for s in sequences]
    table = ablation(restarts)
    return {
        "AUC": float(np.mean([result.scores.auc for result in passes])),
        "drops": float(table.drops),
        "accuracy": table.accuracy,
        "robustness": table.robustness,
    }


def clips_of(folder: Path, count: int | None = None) -> list[Sequence]:
    """The annotated clips in a folder, or so many of them, evenly taken from all.

    Raises:
        ValueError: no clips there, or `count` is below 1.
    """
    found = read_dataset(folder)
    if not found:
        raise ValueError(f"{folder} holds no annotated clips to validate on")
    return _evenly(found, count)


def _evenly(sequences: list[Sequence], count: int | None) -> list[Sequence]:
    if count is None or count >= len(sequences):
        return sequences
    if count < 1:
        raise ValueError(f"{count} clips to validate on; expected 1 or more")
    chosen = np.linspace(0, len(sequences) - 1, count).round().astype(int)
    return [sequences[index] for index in chosen]
