"""The training loop: roll out, learn, average, checkpoint."""

from __future__ import annotations

import copy
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter

from re3.data.sampling import ClipSampler
from re3.network.re3_lite import Re3Lite
from re3.training.features import FrozenTrunk
from re3.training.loss import Losses, tracking_loss
from re3.training.recipe import Recipe
from re3.training.rollout import Rollout, roll_out

CHECKPOINT = "checkpoint.pt"
BEST = "best.pt"


class TrainingError(RuntimeError):
    """Training cannot go on; the message says why and what was kept."""


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


Validate = Callable[[Re3Lite], dict[str, float]]
"""Figures of a network on validation data; the first one decides which weights are best."""


class Trainer:
    """Trains the head of a network on a frozen trunk.

    Every batch is drawn from a generator seeded by the recipe's seed and the iteration, so that
    a resumed run sees what an uninterrupted one would have seen.

    Args:
        network: trained in place.
        sampler: of the clips.
        recipe: curriculum and optimiser.
        folder: of the run: checkpoints and TensorBoard events; resumed if it has a checkpoint.
        threads: of ONNX Runtime and torch.
    """

    def __init__(
        self,
        network: Re3Lite,
        sampler: ClipSampler,
        recipe: Recipe,
        folder: str | Path,
        threads: int = 2,
    ) -> None:
        torch.set_num_threads(threads)
        self.network, self.sampler, self.recipe = network, sampler, recipe
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        # Convolutions learn a quarter faster with the channels last.
        network.head.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.trunk = FrozenTrunk(network, network.config.current.size, threads)
        self.average = copy.deepcopy(network).eval()
        self.optimizer = torch.optim.AdamW(
            network.head.parameters(),
            lr=recipe.learning_rate,
            weight_decay=recipe.weight_decay,
        )
        self.iteration = 0
        self.best = -math.inf
        self._pool = ThreadPoolExecutor(threads)
        if (self.folder / CHECKPOINT).exists():
            self._resume()

    def train(
        self,
        report: Callable[[Progress], None] | None = None,
        validate: Validate | None = None,
        checkpoint_seconds: float = 180.0,
        validation_seconds: float = 900.0,
    ) -> None:
        """Run to the end of the recipe.

        Args:
            report: called after each iteration.
            validate: called with the averaged network every so many seconds and at the end;
                the best weights by its first figure are kept as `best.pt`.
            checkpoint_seconds, validation_seconds: time between two of each.

        Raises:
            TrainingError: the loss is not finite; the last checkpoint is kept.
        """
        events = SummaryWriter(str(self.folder), purge_step=self.iteration)
        started = saved = validated = time.monotonic()
        pairs = 0
        try:
            while self.iteration < self.recipe.iterations:
                index, phase = self.recipe.phase_at(self.iteration)
                rate = self._set_rate()
                losses, rollout = self._step(phase.unroll + 1, phase.batch, phase.own)
                self.iteration += 1
                pairs += len(rollout.targets)
                overlap = losses.mean_overlap
                if self.iteration % 10 == 0:
                    for name, value in losses.parts.items():
                        events.add_scalar(f"loss/{name}", value, self.iteration)
                    events.add_scalar("overlap", overlap, self.iteration)
                    events.add_scalar("put back", rollout.put_back, self.iteration)
                    events.add_scalar("learning rate", rate, self.iteration)
                    events.add_scalar("unroll", phase.unroll, self.iteration)
                now = time.monotonic()
                if report is not None:
                    report(
                        Progress(
                            self.iteration,
                            self.recipe.iterations,
                            index,
                            phase.unroll,
                            losses.total.item(),
                            overlap,
                            pairs / (now - started),
                        )
                    )
                done = self.iteration == self.recipe.iterations
                if done or now - saved > checkpoint_seconds:
                    self.save()
                    saved = time.monotonic()
                if validate is not None and (done or now - validated > validation_seconds):
                    for name, value in self._validate(validate).items():
                        events.add_scalar(f"validation/{name}", value, self.iteration)
                    validated = time.monotonic()
        finally:
            events.close()

    def _step(self, steps: int, batch: int, own: float) -> tuple[Losses, Rollout]:
        head = self.network.head
        seeds = np.random.SeedSequence([self.recipe.seed, self.iteration]).spawn(batch + 1)
        rng = np.random.default_rng(seeds[0])
        clips = list(
            self._pool.map(
                lambda seed: self.sampler.sample(steps, np.random.default_rng(seed)), seeds[1:]
            )
        )
        rollout = roll_out(
            clips, rng.random(batch) < own, head, self.trunk, self.recipe.noise, rng, self._pool
        )
        if self.recipe.passes == self.recipe.parts == 1:
            return self._learn(rollout), rollout
        for _ in range(self.recipe.passes):
            for sequences in np.split(rng.permutation(batch), self.recipe.parts):
                losses = self._learn(rollout.part(sequences))
        return losses, rollout

    def _learn(self, rollout: Rollout) -> Losses:
        """One step of the optimiser."""
        head = self.network.head
        output = head.unroll(rollout.crops, rollout.looked, rollout.steps)
        losses = tracking_loss(
            output, rollout.targets, rollout.has_box, rollout.hidden, self.recipe.loss
        )
        if not torch.isfinite(losses.total):
            raise TrainingError(
                f"the loss is {losses.total.item()} at iteration {self.iteration}; the last "
                f"checkpoint in {self.folder} is kept: resume from it with a lower learning rate"
            )
        self.optimizer.zero_grad(set_to_none=True)
        losses.total.backward()
        torch.nn.utils.clip_grad_norm_(head.parameters(), self.recipe.gradient_norm)
        self.optimizer.step()
        self._update_average()
        return losses

    def _set_rate(self) -> float:
        recipe = self.recipe
        share = self.iteration / max(1, recipe.iterations)
        span = recipe.learning_rate - recipe.final_learning_rate
        rate = recipe.final_learning_rate + span * 0.5 * (1 + math.cos(math.pi * share))
        rate *= min(1.0, (self.iteration + 1) / max(1, recipe.warm_up))
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        return rate

    def _update_average(self) -> None:
        # Early on the average must not remember the initialisation.
        decay = min(self.recipe.average, (1 + self.iteration) / (10 + self.iteration))
        with torch.no_grad():
            for mean, value in zip(
                self.average.head.parameters(), self.network.head.parameters(), strict=True
            ):
                mean.lerp_(value, 1 - decay)

    def _validate(self, validate: Validate) -> dict[str, float]:
        figures = validate(self.average)
        first = next(iter(figures.values()))
        if first > self.best:
            self.best = first
            _save({"network": self.average.state_dict(), "figures": figures}, self.folder / BEST)
        return figures

    def save(self) -> None:
        """Write the checkpoint; a crash leaves either the old one or the new one."""
        _save(
            {
                "network": self.network.state_dict(),
                "average": self.average.state_dict(),
                "optimizer": self.optimizer.state_dict(),
                "iteration": self.iteration,
                "best": self.best,
            },
            self.folder / CHECKPOINT,
        )

    def _resume(self) -> None:
        path = self.folder / CHECKPOINT
        try:
            values = torch.load(path, weights_only=True)
            self.network.load_state_dict(values["network"])
            self.average.load_state_dict(values["average"])
            self.optimizer.load_state_dict(values["optimizer"])
            self.iteration, self.best = values["iteration"], values["best"]
        except (KeyError, RuntimeError, ValueError) as error:
            raise TrainingError(
                f"{path} does not fit this model ({error}); "
                "train into another folder with --out, or remove it"
            ) from error


def _save(values: dict[str, Any], path: Path) -> None:
    partial = path.with_suffix(f".{os.getpid()}.partial")
    torch.save(values, partial)
    partial.replace(path)
