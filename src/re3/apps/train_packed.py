"""`re3 train --packed`: training from packed shards, on a GPU or a CPU."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from re3.apps.console import stderr
from re3.apps.stopping import StopSignals

if TYPE_CHECKING:
    from re3.network.re3_lite import Re3Lite
    from re3.training.packed.draw import ClipDrawer
    from re3.training.packed.rollout import Renderer
    from re3.training.packed.trainer import PackedProgress, PackedTrainer

DEFAULT_MINUTES = 9.0
DECODERS = 8
"""Threads that decode shards."""


@dataclass(frozen=True)
class PackedRun:
    """What the options of `re3 train --packed` ask for.

    Attributes:
        folder: of the shards.
        out: of the run.
        recipe: name, or path of a .yaml file.
        minutes, iterations: length of the run, one of them; by default `DEFAULT_MINUTES`.
        device: `cpu` or `cuda`.
        mixed, compiled, recorded: see `PackedTrainer`.
        workers: processes that draw clips.
        threads: of torch on a CPU.
        seed: in place of the recipe's.
        validation: folder with annotated clips, and `clips`, how many of them.
    """

    folder: Path
    out: Path
    recipe: str
    minutes: float | None
    iterations: int | None
    device: str
    mixed: bool
    compiled: bool
    recorded: bool
    workers: int
    threads: int
    seed: int | None
    validation: Path | None
    clips: int | None


def train_packed(run: PackedRun, network: Re3Lite) -> None:
    """Train a network from packed shards, and write the run's folder.

    Args:
        run: the options.
        network: with the weights to start from; trained in place.

    Raises:
        ValueError, OSError, TrainingError: shards, recipe, device or a checkpoint that cannot be
            used; a loss that is not finite.
    """
    import torch

    from re3.apps.run_folder import note_start
    from re3.training.device import Device
    from re3.training.distributed import join_processes, leave_processes
    from re3.training.packed.trainer import Limit, PackedTrainer
    from re3.training.recipe_file import find_packed_recipe

    recipe = find_packed_recipe(run.recipe)
    if run.seed is not None:
        recipe = replace(recipe, seed=run.seed)
    if run.minutes is None and run.iterations is None:
        limit = Limit(minutes=DEFAULT_MINUTES)
    else:
        limit = Limit(run.minutes, run.iterations)
    Device(run.device, compiled=run.compiled)  # raises where it cannot be used
    processes = join_processes(run.device)
    device = Device(run.device, processes.local_rank, run.mixed, run.compiled)
    torch.set_num_threads(run.threads)
    console = stderr()
    console.quiet = not processes.first
    drawer, renderer = _data(run, network.spec().fill[0], device.torch, console)
    trainer = PackedTrainer(
        network,
        drawer,
        renderer,
        recipe,
        run.out,
        limit,
        device.torch,
        mixed=run.mixed,
        compiled=run.compiled,
        recorded=run.recorded,
        workers=run.workers,
        processes=processes,
    )
    if processes.first:
        note_start(run.out, recipe, trainer.iteration, run.device, processes.count)
    before = _validate(run, trainer, "weights to start from", console) if processes.first else None
    with StopSignals() as stop, Report(console) as report:
        stop.finishing = processes.count > 1
        trainer.train(report, stop=stop)
    if stop():
        console.print(
            f"stopped by {stop.name} at iteration {trainer.iteration}; run the same command to go "
            "on"
        )
        raise typer.Exit(stop.exit_code)
    if processes.first:
        _finish(run, trainer, before, console)
    leave_processes(processes)


def _data(
    run: PackedRun, fill: float, device: object, console: Console
) -> tuple[ClipDrawer, Renderer]:
    """The clips and pictures of the shards, the pictures on the device."""
    import torch

    from re3.data.packed.shards import read_shards
    from re3.data.sampling_config import SamplingConfig
    from re3.training.packed.bank import fill_bank
    from re3.training.packed.draw import ClipDrawer
    from re3.training.packed.index import index_shards
    from re3.training.packed.rollout import Renderer
    from re3.training.recipe_file import with_values

    assert isinstance(device, torch.device), "a device of torch's"
    shards = read_shards(run.folder)
    config = with_values(SamplingConfig(), shards[0].index.sampling)
    index = index_shards(shards, config.smallest)
    with (
        ThreadPoolExecutor(DECODERS) as pool,
        Progress(
            TextColumn("decoding"), BarColumn(), console=console, disable=not console.is_terminal
        ) as bar,
    ):
        task = bar.add_task("decoding", total=len(index.image_sizes))
        bank = fill_bank(
            index.image_sizes,
            index.pictures(pool),
            device,
            lambda done: bar.update(task, completed=done),
        )
    console.print(
        f"{len(shards)} shards: {len(index.tracks)} tracks, {len(index.still_image)} stills, "
        f"{bank.gigabytes():.1f} GB of pictures on {device}",
        markup=False,
    )
    return ClipDrawer(index, config), Renderer(bank, fill, run.compiled)


def _validate(run: PackedRun, trainer: PackedTrainer, what: str, console: Console) -> float | None:
    """Success AUC of the averaged weights on the clips of --val; None without any."""
    if run.validation is None:
        return None
    from re3.apps.validation import Validation

    figures = Validation(run.validation, run.clips)(trainer.result)
    console.print(
        f"{what}: " + ", ".join(f"{name} {value:.3f}" for name, value in figures.items()),
        markup=False,
    )
    return figures["AUC"]


def _finish(run: PackedRun, trainer: PackedTrainer, before: float | None, console: Console) -> None:
    """Write the network for tracking, and say what training brought."""
    from re3.network.export import export_onnx
    from re3.network.weights import save_weights

    network = trainer.result
    name = network.spec().name
    export_onnx(network, run.out / f"{name}.onnx")
    save_weights(network, run.out / f"{name}.safetensors", half=True)
    after = _validate(run, trainer, "trained weights", console)
    if before is not None and after is not None:
        difference = after - before
        better = "trained weights" if difference > 0 else "weights to start from"
        console.print(f"better by {abs(difference):.3f} AUC: the {better}", markup=False)
    console.print(
        f"trained on {trainer.pairs} crop pairs: {run.out / f'{name}.onnx'}; track with: re3 track "
        f"CLIP --box X,Y,W,H --model {run.out / f'{name}.onnx'}",
        markup=False,
    )


class Report:
    """A progress bar on a terminal, a line for each report elsewhere."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self.task = self.bar.add_task("training", total=1.0)

    def __enter__(self) -> Report:
        self.bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.stop()

    def __call__(self, progress: PackedProgress) -> None:
        text = (
            f"iteration {progress.iteration}, loss {progress.loss:.3f}, overlap "
            f"{progress.overlap:.3f}, {progress.pairs_per_second:.0f} pairs/s, "
            f"{progress.seconds_left / 60:.1f} min left"
        )
        self.bar.update(self.task, completed=progress.progress, description=text)
        if not self.console.is_terminal:
            self.console.print(text, markup=False)
