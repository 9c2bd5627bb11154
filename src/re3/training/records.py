"""What a run leaves to read: a line of JSON an iteration, and TensorBoard events."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from torch.utils.tensorboard import SummaryWriter

from re3.geometry import REGRESSION_SCALE
from re3.training.checkpoint import PARTIAL, remove_partial
from re3.training.recipe import Phase
from re3.training.step import Learnt
from re3.training.throughput import Throughput

LOG = "log.jsonl"
SCALARS_EVERY = 10
PICTURES_EVERY = 200
PICTURED_SEQUENCES = 4
PICTURED_STEPS = 8
TRUE_COLOUR, FOUND_COLOUR = (0, 200, 0), (0, 0, 255)  # BGR


@dataclass(frozen=True)
class Progress:
    """What the trainer reports after an iteration.

    Attributes:
        iteration, iterations: done and in all.
        phase: index into the recipe's phases.
        unroll: steps after the initialisation frame.
        loss: of this batch.
        overlap: mean IoU of this batch where there was a true box.
        pairs_per_second: crop pairs learnt from, since the start of this run.
    """

    iteration: int
    iterations: int
    phase: int
    unroll: int
    loss: float
    overlap: float
    pairs_per_second: float


class Records:
    """The log and the events of a run, from an iteration on.

    What an earlier start of the run wrote of later iterations is removed: they are done again. So
    is what it left half written.

    Args:
        folder: of the run.
        iteration: how many iterations are done.
    """

    def __init__(self, folder: Path, iteration: int) -> None:
        remove_partial(folder)
        path = folder / LOG
        _keep_until(path, iteration)
        self._log = path.open("a", encoding="utf-8")
        self._sources: dict[str, list[float]] = {}
        self._events = SummaryWriter(str(folder), purge_step=iteration + 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._log.close()
        self._events.close()

    def iteration(
        self,
        iteration: int,
        phase: Phase,
        learnt: Learnt,
        rate: float,
        seconds: dict[str, float],
        processor: float,
    ) -> None:
        """Note an iteration.

        Args:
            iteration: its number, from 1.
            phase: that it belongs to.
            learnt: by its last step of the optimiser.
            rate: of learning.
            seconds: that each part of it took, as `re3.training.throughput` names them.
            processor: seconds that this process has had of the processor, in all its threads.
        """
        losses = learnt.losses
        figures = {
            "overlap": losses.mean_overlap,
            "put_back": learnt.rollout.put_back,
            "learning_rate": rate,
            "gradient_norm": learnt.gradient_norm,
            "unroll": phase.unroll,
            "batch": phase.batch,
        }
        self._write(
            {
                "iteration": iteration,
                "loss": losses.value,
                "terms": losses.parts,
                "sources": {name: round(value, 4) for name, value in learnt.sources.items()},
                **figures,
                "seconds": {name: round(value, 4) for name, value in seconds.items()},
                "processor": round(processor, 4),
            }
        )
        for source, value in learnt.sources.items():
            self._sources.setdefault(source, []).append(value)
        if iteration % SCALARS_EVERY == 0:
            for source, values in self._sources.items():
                self._events.add_scalar(f"source/{source}", float(np.mean(values)), iteration)
            self._sources.clear()
            named = {f"loss/{name}": value for name, value in losses.parts.items()}
            times = {f"seconds/{name}": value for name, value in seconds.items()}
            for name, value in {"loss/total": losses.value, **named, **figures, **times}.items():
                self._events.add_scalar(name, value, iteration)
        if iteration % PICTURES_EVERY == 0:
            self._events.add_image(
                "crops (green: true, red: found)", pictures(learnt), iteration, dataformats="HWC"
            )

    def throughput(self, iteration: int, ended: Throughput) -> None:
        """Note how fast a phase went that ended with this iteration."""
        self._write({"iteration": iteration, "throughput": ended.figures()})
        self._events.add_scalar("pairs_per_second", ended.pairs_per_second, iteration)

    def validation(self, iteration: int, figures: dict[str, float]) -> None:
        """Note what validation gave."""
        self._write({"iteration": iteration, "validation": figures})
        for name, value in figures.items():
            self._events.add_scalar(f"validation/{name}", value, iteration)

    def _write(self, values: dict[str, Any]) -> None:
        self._log.write(json.dumps(values) + "\n")
        self._log.flush()


def read_log(path: Path) -> list[dict[str, Any]]:
    """The lines of a log; one that a killed process left unfinished is not among them."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    return [json.loads(line) for line in lines if line.endswith("\n")]


def read_iterations(path: Path) -> list[dict[str, Any]]:
    """The lines of a log that are of iterations, not of a validation or a whole phase."""
    return [entry for entry in read_log(path) if "loss" in entry]


def _keep_until(path: Path, iteration: int) -> None:
    if not path.exists():
        return
    kept = [entry for entry in read_log(path) if entry["iteration"] <= iteration]
    partial = path.with_name(path.name + PARTIAL)
    partial.write_text("".join(json.dumps(entry) + "\n" for entry in kept), encoding="utf-8")
    partial.replace(path)


def pictures(learnt: Learnt) -> NDArray[np.uint8]:
    """Crops of some sequences, one a row, with the true box and the one found; uint8 RGB."""
    rollout = learnt.rollout
    steps, size = rollout.steps, rollout.images.shape[1]
    batch = len(rollout.images) // steps
    shown = np.unique(np.linspace(0, steps - 1, PICTURED_STEPS).round().astype(int))
    rows = []
    for sequence in range(min(batch, PICTURED_SEQUENCES)):
        crops = []
        for index in shown * batch + sequence:
            crop = rollout.images[index].copy()
            if rollout.has_box[index]:
                _draw(crop, rollout.targets[index].numpy() / REGRESSION_SCALE * size, TRUE_COLOUR)
            _draw(crop, learnt.corners[index].numpy() / REGRESSION_SCALE * size, FOUND_COLOUR)
            crops.append(crop)
        rows.append(np.concatenate(crops, axis=1))
    return np.ascontiguousarray(np.concatenate(rows)[..., ::-1])


def _draw(
    crop: NDArray[np.uint8], corners: NDArray[np.float32], colour: tuple[int, int, int]
) -> None:
    # Far outside the crop OpenCV's integers would run over.
    x1, y1, x2, y2 = (int(v) for v in np.clip(corners, -crop.shape[0], 2 * crop.shape[0]).round())
    cv2.rectangle(crop, (x1, y1), (x2, y2), colour, 1)
