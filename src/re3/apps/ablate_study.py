"""One ablation study on disk: what was asked, the variants' training, models and results.

ablation.json              what was asked for, and of whom the large and the other source are
A/checkpoint.pt, log.jsonl, recipe.yaml, ...   of the training, as `re3 train` leaves them
A/training.json            written when the training is over; the checkpoint is removed then
A/lite-A.safetensors, A/lite-A.onnx
A/results/...              boxes of the evaluation
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from collections.abc import Sequence as Several
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from re3.apps.pretrained import has_pretrained, load_pretrained
from re3.apps.run_folder import RECIPE, note_start
from re3.data.sampling import ClipSampler
from re3.data.sequence import Sequence
from re3.evaluation.ablation import ABLATION
from re3.evaluation.our_tracker import OurOptions, OurTracker
from re3.evaluation.peers import TrackerInfo
from re3.evaluation.result_files import result_path, write_whole
from re3.evaluation.runner import Progress as EvaluationProgress
from re3.evaluation.runner import run
from re3.evaluation.sequence_result import SequenceResult
from re3.network.base import TrackingNetwork
from re3.network.export import export_onnx
from re3.network.table_one import SCALES, VARIANTS, Variant
from re3.network.variants import build, trainable
from re3.network.weights import load_network, save_weights
from re3.training.ablation import RECIPES, shortened, variant_recipe, variant_sampler
from re3.training.device import Device
from re3.training.recipe import Recipe
from re3.training.recipe_file import find_recipe, read_recipe
from re3.training.records import LOG, Progress, read_iterations
from re3.training.trainer import CHECKPOINT, Trainer

ASKED, TRAINED = "ablation.json", "training.json"
CHECKPOINT_SECONDS = 60.0
TRIAL = 4
"""Iterations of each phase that are timed to turn minutes into iterations."""
LAST = 50
"""Iterations at the end of a training whose mean overlap is told."""


@dataclass(frozen=True)
class Asked:
    """What decides the outcome of a study; one folder holds one of these.

    Attributes:
        scale: `lite` or `paper`.
        minutes: of training a variant; None where iterations are given.
        iterations: of each; None where minutes are given.
        recipe: name or file; None for the scale's own.
        seed: of weights, data and noise.
        data, val: folders.
        exclude: datasets that are left out of the data.
        val_clips: how many clips, evenly taken; None for all.
        large, other: datasets of videos that some variants do without.
    """

    scale: str
    minutes: float | None
    iterations: int | None
    recipe: str | None
    seed: int
    data: tuple[str, ...]
    val: str
    exclude: tuple[str, ...]
    val_clips: int | None
    large: str
    other: str

    def base_recipe(self) -> Recipe:
        """The full model's, at the length it is written down with."""
        recipe = RECIPES[self.scale] if self.recipe is None else find_recipe(self.recipe)
        return replace(recipe, seed=self.seed)

    @classmethod
    def of(cls, out: Path) -> Asked:
        """What was asked of the study in a folder.

        Raises:
            ValueError: there is none, or one of another version.
        """
        path = out / ASKED
        if not path.exists():
            raise ValueError(f"{out} holds no study; expected {ASKED} in it, as a study leaves it")
        try:
            held: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            lists = {name: tuple(held[name]) for name in ("data", "exclude")}
            return cls(**{**held, **lists})
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path} is not a study of this version of re3: {error}") from error

    def keep(self, out: Path) -> None:
        """Note it in the study's folder.

        Raises:
            ValueError: the folder holds a study of which something else was asked.
        """
        path, mine = out / ASKED, json.loads(json.dumps(asdict(self)))
        if path.exists():
            held = json.loads(path.read_text(encoding="utf-8"))
            if differs := [name for name in mine if mine[name] != held.get(name)]:
                name = differs[0]
                raise ValueError(
                    f"{out} holds a study with {name} {held.get(name)!r}, not {mine[name]!r}; give "
                    "the same options to go on with it, or another folder with --out"
                )
        write_whole(path, json.dumps(mine, indent=2) + "\n")


class Study:
    """Trains and evaluates variants, each once.

    Args:
        asked: what was asked for.
        out: folder of the study.
        data: everything to train on; None for one that is only looked at.
        threads: of training and tracking.
        pretrained: files of convolutions, for the variants that they fit.
        device: to train on.
    """

    def __init__(
        self,
        asked: Asked,
        out: Path,
        data: ClipSampler | None,
        threads: int = 2,
        pretrained: Several[Path] = (),
        device: str = "cpu",
    ) -> None:
        self.asked, self.out, self.data = asked, out, data
        self.threads, self.pretrained, self.device = threads, tuple(pretrained), Device(device)
        self.scale = SCALES[asked.scale]

    def trained_as(self, variant: Variant) -> Variant:
        """The first variant whose training is the same."""
        return next(v for v in VARIANTS.values() if v.training == variant.training)

    def sampler(self, variant: Variant) -> ClipSampler:
        """What a variant is trained on; raises as `variant_sampler` does."""
        assert self.data is not None, "a study without data cannot be trained"
        return variant_sampler(
            variant, self.data, self.asked.large, self.asked.other, self.asked.scale
        )

    def trained(self, variant: Variant) -> dict[str, Any] | None:
        """What is noted of a variant's training; None if it is not over."""
        path = self.out / self.trained_as(variant).letter / TRAINED
        if not path.exists():
            return None
        noted: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return noted

    def check(self, variant: Variant) -> None:
        """See that a variant can be trained, before any is.

        Raises:
            ValueError: there is nothing to train it on, or its weights are missing.
        """
        self.sampler(self.trained_as(variant))
        if self.asked.base_recipe().learn_trunk:
            return
        with torch.device("meta"):
            outline = build(self.scale.config(variant))
        if not has_pretrained(outline, self.pretrained):
            raise self._no_weights(variant)

    def train(
        self,
        variant: Variant,
        report: Callable[[Progress], None] | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Train a variant, or go on with it, unless that is over.

        Returns:
            whether it is over now; not if `stop` said so.

        Raises:
            ValueError, TrainingError: nothing to train on, no pretrained weights, or a loss that is
                not finite.
        """
        if self.trained(variant) is not None:
            return True
        variant = self.trained_as(variant)
        folder, sampler = self.out / variant.letter, self.sampler(variant)
        folder.mkdir(parents=True, exist_ok=True)
        kept = folder / RECIPE
        recipe = read_recipe(kept) if kept.exists() else self._plan(variant, sampler)
        network = self._network(variant, recipe)
        trainer = Trainer(network, sampler, recipe, folder, self.threads, self.device)
        note_start(folder, recipe, trainer.iteration, self.device.kind)
        trainer.train(report, checkpoint_seconds=CHECKPOINT_SECONDS, stop=stop)
        if trainer.iteration < recipe.iterations:
            return False
        self._finish(variant, trainer)
        return True

    def _network(self, variant: Variant, recipe: Recipe) -> TrackingNetwork:
        """The variant with fresh weights, its convolutions pretrained where they can be."""
        torch.manual_seed(recipe.seed)
        network = trainable(build(self.scale.config(variant)))
        if not load_pretrained(network, self.pretrained) and not recipe.learn_trunk:
            raise self._no_weights(variant)
        return network

    def _no_weights(self, variant: Variant) -> ValueError:
        trunk = self.scale.config(variant).trunk
        return ValueError(
            f"variant {variant.letter} ({variant.about}) is to be trained on frozen convolutions "
            f"of {trunk}, whose weights are not at hand; give them with --pretrained FILE, take a "
            "recipe with learn_trunk, or leave it out with --variants"
        )

    def _plan(self, variant: Variant, sampler: ClipSampler) -> Recipe:
        """The recipe at the length asked for; minutes are turned to iterations by a trial."""
        recipe = variant_recipe(variant, self.asked.base_recipe())
        if self.asked.iterations is not None:
            return shortened(recipe, self.asked.iterations)
        assert self.asked.minutes is not None, "one of both is asked for"
        trial = replace(recipe, phases=tuple(replace(p, iterations=TRIAL) for p in recipe.phases))
        with tempfile.TemporaryDirectory() as scratch:
            network = self._network(variant, trial)
            Trainer(network, sampler, trial, scratch, self.threads, self.device).train()
            log = read_iterations(Path(scratch) / LOG)
        seconds = 0.0
        for index, phase in enumerate(recipe.phases):
            # The first iteration of each phase also warms caches up.
            taken = [self._taken(entry) for entry in log[index * TRIAL + 1 : (index + 1) * TRIAL]]
            seconds += float(np.mean(taken)) * phase.iterations
        iterations = recipe.iterations * self.asked.minutes * 60 / seconds
        return shortened(recipe, max(len(recipe.phases), round(iterations)))

    def _taken(self, entry: dict[str, Any]) -> float:
        """Seconds of the budget that an iteration took, by its line of the log.

        On a CPU those that the process had of the processor, shared out among its threads: what
        else runs on the machine takes nothing away from a variant. On a GPU the clock's.
        """
        if self.device.kind == "cpu":
            return float(entry["processor"]) / self.threads
        return float(sum(entry["seconds"].values()))

    def _finish(self, variant: Variant, trainer: Trainer) -> None:
        folder = self.out / variant.letter
        save_weights(trainer.result, self._weights(variant))
        log = read_iterations(folder / LOG)
        shares = {
            f"{name}, {kind}": s for (name, kind), s in self.sampler(variant).shares().items()
        }
        noted = {
            "iterations": trainer.iteration,
            "seconds": sum(self._taken(entry) for entry in log),
            "clock_seconds": sum(sum(entry["seconds"].values()) for entry in log),
            "pairs": sum(entry["batch"] * (entry["unroll"] + 1) for entry in log),
            "last_overlap": sum(e["overlap"] for e in log[-LAST:]) / len(log[-LAST:]),
            "sources": shares,
        }
        write_whole(folder / TRAINED, json.dumps(noted, indent=2) + "\n")
        (folder / CHECKPOINT).unlink(missing_ok=True)

    def _weights(self, variant: Variant) -> Path:
        name = self.scale.config(variant).name
        return self.out / variant.letter / f"{name}.safetensors"

    def model(self, variant: Variant) -> Path:
        """The exported network of a trained variant; written if it is not there yet."""
        config = self.scale.config(variant)
        path = self.out / variant.letter / f"{config.name}.onnx"
        if not path.exists():
            network = build(config)
            weights = load_network(self._weights(self.trained_as(variant)))
            network.load_state_dict(weights.state_dict())
            export_onnx(network, path)
        return path

    def evaluate(
        self,
        variant: Variant,
        sequences: list[Sequence],
        on_progress: Callable[[EvaluationProgress], None] | None = None,
    ) -> list[SequenceResult]:
        """Run a trained variant with restarts; clips that it has run on are not run again."""
        factory = partial(OurTracker, str(self.model(variant)), OurOptions(threads=self.threads))
        info = TrackerInfo(variant.letter, variant.about, factory)
        folder = self._results(variant)
        return run([info], sequences, folder, True, on_progress, supervised=ABLATION)

    def results(
        self, variants: list[Variant], sequences: list[Sequence]
    ) -> dict[str, list[SequenceResult]]:
        """By letter, what was evaluated to its end; nothing is trained or run."""
        return {
            variant.letter: self.evaluate(variant, sequences)
            for variant in variants
            if self.trained(variant) is not None
            and all(
                result_path(self._results(variant), variant.letter, sequence).exists()
                for sequence in sequences
            )
        }

    def _results(self, variant: Variant) -> Path:
        return self.out / variant.letter / "results"
