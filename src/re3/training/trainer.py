"""The training loop: roll out, learn, average, checkpoint (Re3, sec. III-B and III-C)."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn.utils import convert_conv2d_weight_memory_format

from re3.data.sampling import ClipSampler
from re3.network.base import TrackingNetwork
from re3.network.weights import with_only_learnt
from re3.training.average import update_average
from re3.training.batches import Batches
from re3.training.checkpoint import load, save_whole
from re3.training.curriculum import Curriculum
from re3.training.device import Device
from re3.training.distributed import ALONE, Processes, check_shares
from re3.training.errors import TrainingError
from re3.training.failure import failure_path, save_failure
from re3.training.features import FrozenTrunk, TorchTrunk, Trunk
from re3.training.recipe import Phase, Recipe
from re3.training.records import Progress, Records
from re3.training.rollout import Rollout, roll_out
from re3.training.step import Learner, Learnt, NotFinite, choose_parts
from re3.training.throughput import Meter, Stopwatch, Throughput

__all__ = ["BEST", "CHECKPOINT", "Progress", "Trainer", "TrainingError", "Validate"]

CHECKPOINT = "checkpoint.pt"
BEST = "best.pt"


Validate = Callable[[TrackingNetwork], dict[str, float]]
"""Figures of a network on validation data; the first one decides which weights are best."""


class Trainer:
    """Trains a network: its head on a frozen trunk, or all of it, as the recipe says.

    A run that is killed and resumed learns what an uninterrupted one would have learnt, and several
    processes together what one would.

    Args:
        network: trained in place.
        sampler: of the clips; outside of frames they show the colour that the network's tracker
            shows there.
        recipe: curriculum and optimiser.
        folder: of the run: checkpoints, log and TensorBoard events; resumed if it has a checkpoint.
        threads: of ONNX Runtime and torch, in this process.
        device: to compute on; clips are drawn and cut on the CPU.
        processes: that train together, each with its share of every batch.

    Attributes:
        average: the mean of the weights that is validated and exported; see `result`.
        iteration: how many are done.
        earlier_recipe: as a dictionary, of the checkpoint that the run was resumed from, or None.

    Raises:
        TrainingError: the checkpoint found is of another model, or the processes are too many.
    """

    def __init__(
        self,
        network: TrackingNetwork,
        sampler: ClipSampler,
        recipe: Recipe,
        folder: str | Path,
        threads: int = 2,
        device: Device | None = None,
        processes: Processes = ALONE,
    ) -> None:
        torch.set_num_threads(threads)
        if isinstance(sampler, ClipSampler):
            sampler = sampler.with_fill(network.spec().fill)
        check_shares(recipe, processes)
        self.recipe, self.processes = recipe, processes
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.device = device or Device()
        # Batch normalisation keeps its statistics: batches are small, their crops alike.
        self.network = network.to(self.device.torch).eval()
        network.trunk.requires_grad_(recipe.learn_trunk)
        if recipe.trunk_stages:
            network.let_trunk_learn(recipe.trunk_stages)
        if not recipe.trunk_depthwise:
            _freeze_depthwise(network.trunk)
        choose_parts(network, recipe)
        for part in (*network.parts().values(), network.trunk):
            # Convolutions learn a quarter faster with the channels last.
            convert_conv2d_weight_memory_format(part, torch.channels_last)
        self.average = copy.deepcopy(network)
        groups, self._shares = _groups(network, recipe)
        self.optimizer = torch.optim.AdamW(
            groups, lr=recipe.learning_rate, weight_decay=recipe.weight_decay
        )
        self.curriculum = Curriculum(recipe)
        self.iteration = 0
        self.best = -math.inf
        self.earlier_recipe: dict[str, Any] | None = None
        self._seconds: dict[str, float] = {}
        self._pool = ThreadPoolExecutor(threads)
        self._batches = Batches(sampler, recipe, processes, self._pool)
        self._learner = Learner(network, recipe, self.optimizer, self.device, processes)
        if (self.folder / CHECKPOINT).exists():
            self._resume()
        self.trunk: Trunk
        if recipe.learn_trunk or self.device.kind == "cuda":
            self.trunk = TorchTrunk(network, self.device)
        else:
            self.trunk = FrozenTrunk(network, threads)

    def train(
        self,
        report: Callable[[Progress], None] | None = None,
        validate: Validate | None = None,
        checkpoint_seconds: float = 180.0,
        validation_seconds: float = 900.0,
        stop: Callable[[], bool] = lambda: False,
        on_phase: Callable[[Throughput], None] | None = None,
    ) -> None:
        """Run to the end of the recipe.

        Args:
            report: called after each iteration.
            validate: called with the averaged network every so many seconds, after each phase and
                at the end; the best weights by its first figure are kept as `best.pt`.
            checkpoint_seconds, validation_seconds: time between two of each.
            stop: asked before each iteration; once it says so, a checkpoint is written, and that
                is all.
            on_phase: called after each phase, with how fast it went.

        Raises:
            TrainingError: a loss or a gradient is not finite; the batch and the last checkpoint
                are kept.
        """
        started = saved = validated = time.monotonic()
        pairs, first, used = 0, self.processes.first, time.process_time()
        meter = Meter()
        with Records(self.folder, self.iteration) if first else nullcontext() as records:
            while self.iteration < self.recipe.iterations:
                if self.processes.any(stop()):
                    self.save()
                    return
                index, phase = self.curriculum.index, self.curriculum.phase
                rate = self._set_rate()
                learnt = self._step(phase)
                self.iteration += 1
                moved = self.curriculum.advance(self.iteration, learnt.losses.value)
                if records is None:
                    continue
                before, used = used, time.process_time()
                records.iteration(self.iteration, phase, learnt, rate, self._seconds, used - before)
                now = time.monotonic()
                pairs += phase.batch * (phase.unroll + 1)
                meter.add(self._seconds)
                done = self.iteration == self.recipe.iterations
                if moved or done:
                    ended = meter.end(index, phase)
                    records.throughput(self.iteration, ended)
                    if on_phase is not None:
                        on_phase(ended)
                if report is not None:
                    report(
                        Progress(
                            self.iteration,
                            self.recipe.iterations,
                            index,
                            phase.unroll,
                            learnt.losses.value,
                            learnt.losses.mean_overlap,
                            pairs / (now - started),
                        )
                    )
                due = done or moved or now - validated > validation_seconds
                if validate is not None and due:
                    records.validation(self.iteration, self._validate(validate))
                    validated = time.monotonic()
                # After the validation, or a run killed during its last one would never have it.
                if done or now - saved > checkpoint_seconds:
                    self.save()
                    saved = time.monotonic()

    def _step(self, phase: Phase) -> Learnt:
        """Draw clips, walk them, learn from all their steps."""
        watch = Stopwatch()
        with watch.time("clips"):
            batch = self._batches.get(self.iteration, phase)
        with self.device.autocast():
            rollout = roll_out(
                batch.clips,
                batch.own,
                self.network,
                self.trunk,
                self.recipe.noise,
                batch.draws,
                self._pool,
                watch,
                self.recipe.loss.outline > 0,
            )
        if self.iteration + 1 < self.recipe.iterations:
            self._batches.prepare(self.iteration + 1, phase)
        with watch.time("learn"):
            learnt = self._learn_in_parts(rollout, batch.rng)
        self._seconds = watch.seconds
        return learnt

    def _learn_in_parts(self, rollout: Rollout, rng: np.random.Generator) -> Learnt:
        """All passes over a roll-out; parts are drawn within each process's share."""
        if self.recipe.passes == self.recipe.parts == 1:
            return self._learn(rollout)
        share = len(rollout.targets) // rollout.steps
        for _ in range(self.recipe.passes):
            for sequences in np.split(rng.permutation(share), self.recipe.parts):
                learnt = self._learn(rollout.part(sequences))
        return learnt

    def _learn(self, rollout: Rollout) -> Learnt:
        """One step of the optimiser."""
        try:
            learnt = self._learner.learn(rollout)
        except NotFinite as error:
            path = failure_path(self.folder, self.iteration, self.processes.rank)
            save_failure(path, error, self.network, self.recipe, self.iteration)
            raise TrainingError(
                f"{error} at iteration {self.iteration}, in phase {self.curriculum.index + 1} of "
                f"{len(self.recipe.phases)}; the batch is in {path}. The last checkpoint in "
                f"{self.folder} is kept: resume from it with a lower learning rate"
            ) from error
        update_average(self.average, self.network, self.recipe.average, self.iteration)
        return learnt

    def _set_rate(self) -> float:
        rate = self.recipe.rate_at(self.iteration)
        for group, share in zip(self.optimizer.param_groups, self._shares, strict=True):
            group["lr"] = rate * share
        return rate

    @property
    def result(self) -> TrackingNetwork:
        """The averaged network, on the CPU, to be validated and exported."""
        return self.average if self.device.kind == "cpu" else copy.deepcopy(self.average).cpu()

    def best_network(self) -> TrackingNetwork | None:
        """The averaged network with the best validation, on the CPU; None without any."""
        path = self.folder / BEST
        if not path.exists():
            return None
        best = copy.deepcopy(self.result)
        best.load_state_dict(with_only_learnt(load(path)["network"], best))
        return best

    def _validate(self, validate: Validate) -> dict[str, float]:
        figures = validate(self.result)
        first = next(iter(figures.values()))
        if first > self.best:
            self.best = first
            save_whole(
                {
                    "network": self.average.state_dict(),
                    "figures": figures,
                    "iteration": self.iteration,
                },
                self.folder / BEST,
            )
        return figures

    def save(self) -> None:
        """Write the checkpoint; a crash leaves either the old one or the new one."""
        if self.processes.first:
            save_whole(self._state(), self.folder / CHECKPOINT)

    def _state(self) -> dict[str, Any]:
        # Where in the data training is follows from the seed and the iteration.
        return {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "scaler": self._learner.scaler.state_dict(),
            "curriculum": self.curriculum.state(),
            "iteration": self.iteration,
            "torch_rng": torch.get_rng_state(),
            "recipe": asdict(self.recipe),
        }

    def _resume(self) -> None:
        path = self.folder / CHECKPOINT
        try:
            values = load(path, str(self.device.torch))
            self.network.load_state_dict(with_only_learnt(values["network"], self.network))
            self.average.load_state_dict(with_only_learnt(values["average"], self.average))
            self.optimizer.load_state_dict(values["optimizer"])
            if values["scaler"]:  # of a GPU
                self._learner.scaler.load_state_dict(values["scaler"])
            self.iteration = values["iteration"]
            self.curriculum.restore(values["curriculum"], self.iteration)
            torch.set_rng_state(values["torch_rng"].cpu())
            self.earlier_recipe = values["recipe"]
            best = self.folder / BEST
            self.best = next(iter(load(best)["figures"].values())) if best.exists() else -math.inf
        except (KeyError, RuntimeError, ValueError) as error:
            raise TrainingError(
                f"{path} does not fit this model ({error}); "
                "train into another folder with --out, or remove it"
            ) from error


def _freeze_depthwise(trunk: nn.Module) -> None:
    for module in trunk.modules():
        if isinstance(module, nn.Conv2d) and module.groups > 1:
            module.requires_grad_(False)


def _groups(network: TrackingNetwork, recipe: Recipe) -> tuple[list[dict[str, Any]], list[float]]:
    """Parameters that learn, of the head and of the trunk, and each group's share of the rate."""
    trunk = {id(parameter) for parameter in network.trunk.parameters()}
    learns = [parameter for parameter in network.parameters() if parameter.requires_grad]
    both = [
        ([p for p in learns if id(p) not in trunk], 1.0),
        ([p for p in learns if id(p) in trunk], recipe.trunk_rate),
    ]
    used = [(parameters, share) for parameters, share in both if parameters]
    return [{"params": parameters} for parameters, _ in used], [share for _, share in used]
