"""The training loop on packed data: specs from the host, everything else on the device.

BatchNorm of the backbone keeps the statistics of its pretraining and learns scale and shift: a
batch holds the crops of few clips, which are alike, so that statistics of the batch would leak
from one crop to the next and differ from those of tracking.
"""

from __future__ import annotations

import copy
import json
import math
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils import convert_conv2d_weight_memory_format
from torch.utils.data import DataLoader, Dataset

from re3.network.base import Prediction
from re3.network.re3_lite import Re3Lite
from re3.network.weights import save_weights
from re3.training.checkpoint import load, save_whole
from re3.training.distributed import ALONE, Processes
from re3.training.errors import TrainingError
from re3.training.loss import loss_terms
from re3.training.packed.clips import ClipBatch
from re3.training.packed.draw import ClipDrawer
from re3.training.packed.graph import RecordedStep
from re3.training.packed.recipe import PackedRecipe, Stage
from re3.training.packed.rollout import Renderer, roll_out

CHECKPOINT = "checkpoint.pt"
LOG = "log.jsonl"
REPORT_EVERY = 20
"""Iterations between two lines of the log, for each of which the host waits for the device."""


@dataclass(frozen=True)
class PackedProgress:
    """What the trainer reports.

    Attributes:
        iteration: how many are done.
        progress: share of the run.
        loss, overlap: mean over the iterations since the last report.
        pairs_per_second: crop pairs learnt from, likewise.
        pairs: since the run began.
        seconds_left: of the run.
    """

    iteration: int
    progress: float
    loss: float
    overlap: float
    pairs_per_second: float
    pairs: int
    seconds_left: float


@dataclass(frozen=True)
class Limit:
    """How long a run is: in minutes, or in iterations; one of them.

    Raises:
        ValueError: both or neither is given, or it is not above 0.
    """

    minutes: float | None = None
    iterations: int | None = None

    def __post_init__(self) -> None:
        given = [value for value in (self.minutes, self.iterations) if value is not None]
        if len(given) != 1 or not given[0] > 0:
            raise ValueError(
                f"minutes is {self.minutes} and iterations {self.iterations}; expected one of them,"
                " above 0"
            )

    def progress(self, iteration: int, seconds: float) -> float:
        """Share of the run, 0 to 1, after so many iterations and seconds."""
        if self.iterations is not None:
            return min(iteration / self.iterations, 1.0)
        assert self.minutes is not None, "one of them is given"
        return min(seconds / (60 * self.minutes), 1.0)


class PackedTrainer:
    """Trains a network of the kind of `re3-lite`, all of it, from packed data.

    Args:
        network: trained in place.
        drawer: of the clips.
        renderer: of their crops, on the device.
        recipe: stages and optimiser.
        folder: of the run: checkpoint, weights and log; resumed if it has a checkpoint.
        limit: how long the run is.
        device: to compute on.
        mixed: convolutions and matrix products in bfloat16.
        compiled: backbone and embedding are compiled by torch.
        recorded: the step is replayed from a CUDA graph. A resumed run then draws other noise than
            an uninterrupted one.
        workers: processes that draw clips; 0 draws them in this one.
        processes: that train together, each with its share of every batch.

    Raises:
        TrainingError: the checkpoint found does not fit the network.
    """

    def __init__(
        self,
        network: Re3Lite,
        drawer: ClipDrawer,
        renderer: Renderer,
        recipe: PackedRecipe,
        folder: str | Path,
        limit: Limit,
        device: torch.device,
        mixed: bool = False,
        compiled: bool = False,
        recorded: bool = False,
        workers: int = 0,
        processes: Processes = ALONE,
    ) -> None:
        self.recipe, self.limit, self.device, self.mixed = recipe, limit, device, mixed
        self.drawer, self.renderer = drawer, renderer
        self.workers, self.processes = workers, processes
        self.recorded = recorded
        self._record: RecordedStep | None = None
        self._names: list[str] = []
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.network = network.to(device).eval()
        network.requires_grad_(True)
        if not recipe.loss.outline:
            network.head.outline.requires_grad_(False)
        for part in (network.trunk, *network.parts().values()):
            convert_conv2d_weight_memory_format(part, torch.channels_last)
        self.average = copy.deepcopy(network)
        backbone = {id(parameter) for parameter in network.trunk.parameters()}
        self._learnt: list[Tensor] = [p for p in network.parameters() if p.requires_grad]
        self._averaged: list[Tensor] = [
            mean
            for mean, p in zip(self.average.parameters(), network.parameters(), strict=True)
            if p.requires_grad
        ]
        head = [p for p in self._learnt if id(p) not in backbone]
        others = [p for p in self._learnt if id(p) in backbone]
        groups: list[dict[str, Any]] = [
            {"params": head, "share": 1.0},
            {"params": others, "share": recipe.backbone_rate},
        ]
        self.optimizer = torch.optim.AdamW(
            groups,
            lr=recipe.learning_rate,
            weight_decay=recipe.weight_decay,
            fused=device.type == "cuda",
        )
        self._embed: Callable[[Tensor], Tensor] = Embed(network)
        if compiled:
            self._embed = torch.compile(self._embed, dynamic=False)
        self.iteration = 0
        self.pairs = 0
        self.seconds = 0.0
        if (self.folder / CHECKPOINT).exists():
            self._resume()

    def train(
        self,
        report: Callable[[PackedProgress], None] = lambda progress: None,
        checkpoint_seconds: float = 60.0,
        kept: int = 3,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run to the limit.

        Args:
            report: called every `REPORT_EVERY` iterations.
            checkpoint_seconds: between two checkpoints, each with the averaged weights in half
                precision beside it.
            kept: so many of the latest weights are kept.
            stop: asked before each iteration; once it says so, a checkpoint is written, and that
                is all.

        Raises:
            TrainingError: the loss is not finite; the last checkpoint is kept.
        """
        meter = _Meter(self.folder / LOG, self.processes.first)
        started, before = time.monotonic(), self.seconds
        saved = started
        batches: Iterator[ClipBatch] | None = None
        stage: Stage | None = None
        while not self.processes.any(stop()):
            progress = self.limit.progress(self.iteration, self.seconds)
            if progress >= 1.0:
                break
            if (current := self.recipe.stage_at(progress)) != stage or batches is None:
                stage, self._record = current, None
                batches = iter(self._loader(stage))
            waited = time.monotonic()
            clips = next(batches).to(self.device)
            waited = time.monotonic() - waited
            rate = self._set_rate(progress)
            figures = self._step(clips, stage)
            self.iteration += 1
            self.pairs += stage.batch * (stage.unroll + 1)
            meter.add(self._names, figures, waited, stage.batch * (stage.unroll + 1))
            last = self.iteration == self.limit.iterations
            if self.iteration % REPORT_EVERY == 0 or self.iteration <= 2 or last:
                means = meter.end()
                if not math.isfinite(means["loss"]):
                    raise TrainingError(
                        f"the loss is {means['loss']} at iteration {self.iteration}; the last "
                        f"checkpoint in {self.folder} is kept: resume from it with a lower "
                        "learning rate"
                    )
                means |= {
                    "iteration": self.iteration,
                    "progress": progress,
                    "unroll": stage.unroll,
                    "learning_rate": rate,
                    "pairs": self.pairs,
                }
                meter.write(means)
                report(self._progress(progress, means))
            now = time.monotonic()
            self.seconds = before + now - started
            if now - saved > checkpoint_seconds:
                self.save(kept)
                saved = time.monotonic()
        self.save(kept)

    def _progress(self, progress: float, figures: dict[str, Any]) -> PackedProgress:
        left = self.seconds * (1 - progress) / progress if progress else math.inf
        if self.limit.minutes is not None:
            left = 60 * self.limit.minutes - self.seconds
        return PackedProgress(
            self.iteration,
            progress,
            figures["loss"],
            figures["mean_overlap"],
            figures["pairs_per_second"],
            self.pairs,
            left,
        )

    def _loader(self, stage: Stage) -> DataLoader[ClipBatch]:
        count = stage.batch // self.processes.count
        specs = Specs(self.drawer, count, stage.unroll + 1, self.recipe.seed, self.processes.rank)
        many = self.workers > 0
        return DataLoader(
            specs,
            batch_size=None,
            sampler=range(self.iteration, 1 << 40),
            num_workers=self.workers,
            prefetch_factor=4 if many else None,
            pin_memory=self.device.type == "cuda",
        )

    def _step(self, clips: ClipBatch, stage: Stage) -> Tensor:
        """Walk the clips and take one step of the optimiser; figures by `self._names`."""
        if self.recorded and self._record is None:
            self._record = self._recorded(clips, stage)
        if self._record is not None:
            figures = self._record(clips)
        else:
            self.optimizer.zero_grad(set_to_none=True)
            figures = self._gradients(clips, stage, self._generator())
        self._share_gradients()
        torch.nn.utils.clip_grad_norm_(self._learnt, self.recipe.gradient_norm, foreach=True)
        self.optimizer.step()
        decay = min(self.recipe.average, (1 + self.iteration) / (10 + self.iteration))
        with torch.no_grad():
            torch._foreach_lerp_(self._averaged, self._learnt, 1 - decay)
        return figures

    def _recorded(self, clips: ClipBatch, stage: Stage) -> RecordedStep | None:
        """The step as a CUDA graph; None where it cannot be recorded."""
        generator = self._generator()
        learnt = [p for p in self._learnt if isinstance(p, nn.Parameter)]
        try:
            return RecordedStep(
                lambda given: self._gradients(given, stage, generator), clips, learnt, generator
            )
        except RuntimeError as error:
            warnings.warn(
                f"the training step cannot be recorded as a CUDA graph ({error}); its kernels are "
                "launched one by one, which is slower",
                stacklevel=2,
            )
            self.recorded = False
            return None

    def _generator(self) -> torch.Generator:
        """Of the noise of this iteration, on the device."""
        seed = np.random.SeedSequence([self.recipe.seed, self.iteration, self.processes.rank, 1])
        generator = torch.Generator(device=self.device)
        generator.manual_seed(int(seed.generate_state(1, np.uint64)[0] >> 1))
        return generator

    def _gradients(self, clips: ClipBatch, stage: Stage, generator: torch.Generator) -> Tensor:
        """Leave the gradients of clips in the parameters; figures by `self._names`."""
        own = torch.rand(clips.clips, generator=generator, device=self.device) < stage.own
        with torch.autocast(self.device.type, dtype=torch.bfloat16, enabled=self.mixed):
            rollout = roll_out(
                clips, own, self.network, self._embed, self.renderer, self.recipe.noise, generator
            )
            found = self.network.head.unroll(
                rollout.embeddings, rollout.previous_boxes, clips.frames
            )
        output = Prediction(
            found.corners.float(), found.score_logit.float(), found.heat_logits.float()
        )
        terms = loss_terms(
            output,
            rollout.targets,
            rollout.has_box,
            rollout.hidden,
            self.recipe.loss,
            self.processes,
        )
        terms.total.backward()
        figures = {
            "loss": terms.total,
            "mean_overlap": terms.mean_overlap,
            "recentred": rollout.recentred,
            **terms.parts,
        }
        self._names = list(figures)
        return torch.stack([value.detach().float() for value in figures.values()])

    def _share_gradients(self) -> None:
        """The mean over the processes of their gradients."""
        if self.processes.count == 1:
            return
        gradients = [p.grad for p in self._learnt if p.grad is not None]
        flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
        torch.distributed.all_reduce(flat)
        flat /= self.processes.count
        begin = 0
        for gradient in gradients:
            gradient.copy_(flat[begin : begin + gradient.numel()].view_as(gradient))
            begin += gradient.numel()

    def _set_rate(self, progress: float) -> float:
        rate = self.recipe.rate_at(progress)
        for group in self.optimizer.param_groups:
            group["lr"] = rate * group["share"]
        return rate

    @property
    def result(self) -> Re3Lite:
        """The averaged network, on the CPU."""
        return copy.deepcopy(self.average).cpu()

    def save(self, kept: int = 3) -> None:
        """Write the checkpoint, and the averaged weights in half precision."""
        if not self.processes.first:
            return
        save_whole(
            {
                "network": self.network.state_dict(),
                "average": self.average.state_dict(),
                "optimizer": self.optimizer.state_dict(),
                "iteration": self.iteration,
                "pairs": self.pairs,
                "seconds": self.seconds,
                "recipe": asdict(self.recipe),
            },
            self.folder / CHECKPOINT,
        )
        save_weights(
            self.average, self.folder / f"weights-{self.iteration:06}.safetensors", half=True
        )
        for path in sorted(self.folder.glob("weights-*.safetensors"))[:-kept]:
            path.unlink()

    def _resume(self) -> None:
        path = self.folder / CHECKPOINT
        try:
            values = load(path, str(self.device))
            self.network.load_state_dict(values["network"])
            self.average.load_state_dict(values["average"])
            self.optimizer.load_state_dict(values["optimizer"])
            self.iteration, self.pairs = values["iteration"], values["pairs"]
            self.seconds = values["seconds"]
        except (KeyError, RuntimeError, ValueError) as error:
            raise TrainingError(
                f"{path} does not fit this model ({error}); train into another folder with --out, "
                "or remove it"
            ) from error


class Embed(nn.Module):
    """Backbone and embedding of crops, float32 `[N, S, S, 3]` BGR."""

    def __init__(self, network: Re3Lite) -> None:
        super().__init__()
        self.trunk, self.embedding = network.trunk, network.head.embedding
        self.centred = network.centred

    def forward(self, crops: Tensor) -> Tensor:
        embedding: Tensor = self.embedding(self.trunk(self.centred(crops)))
        return embedding


class Specs(Dataset[ClipBatch]):
    """The clips of each iteration, drawn from the seed, the iteration and the process.

    Args:
        drawer: of the clips.
        clips, frames: N and T of each batch.
        seed: of the recipe.
        rank: of the process.
    """

    def __init__(
        self, drawer: ClipDrawer, clips: int, frames: int, seed: int, rank: int = 0
    ) -> None:
        self.drawer, self.clips, self.frames = drawer, clips, frames
        self.seed, self.rank = seed, rank

    def __getitem__(self, iteration: int) -> ClipBatch:
        rng = np.random.default_rng([self.seed, iteration, self.rank])
        return self.drawer.draw(self.clips, self.frames, rng)


class _Meter:
    """Sums figures on the device; reads them once in a while."""

    def __init__(self, path: Path, writes: bool) -> None:
        self._log = path.open("a", encoding="utf-8") if writes else None
        self._begin()

    def _begin(self) -> None:
        self._sums: Tensor | None = None
        self._names: list[str] = []
        self._count, self._waited, self._pairs = 0, 0.0, 0
        self._started = time.monotonic()

    def add(self, names: list[str], figures: Tensor, waited: float, pairs: int) -> None:
        self._names = names
        # A copy: a recorded step overwrites its figures.
        self._sums = figures.clone() if self._sums is None else self._sums + figures
        self._count += 1
        self._waited += waited
        self._pairs += pairs

    def end(self) -> dict[str, Any]:
        """Means since the last call; waits for the device."""
        assert self._sums is not None, "there was an iteration"
        means = (self._sums / self._count).tolist()
        seconds = time.monotonic() - self._started
        figures: dict[str, Any] = dict(zip(self._names, means, strict=True))
        figures |= {
            "seconds": round(seconds / self._count, 4),
            "waited": round(self._waited / self._count, 4),
            "pairs_per_second": round(self._pairs / seconds, 1),
        }
        if torch.cuda.is_available():
            figures["gigabytes"] = round(torch.cuda.max_memory_allocated() / 1e9, 2)
        self._begin()
        return figures

    def write(self, figures: dict[str, Any]) -> None:
        if self._log is not None:
            self._log.write(json.dumps(figures) + "\n")
            self._log.flush()
