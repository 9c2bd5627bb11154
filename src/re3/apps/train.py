"""`re3 train`: train a network on videos with boxes and on simulated sequences."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.pretrained import load_pretrained
from re3.apps.sequences import FORMAT_HELP
from re3.apps.stopping import StopSignals
from re3.apps.train_packed import PackedRun, train_packed
from re3.apps.train_report import Report
from re3.apps.training_data import (
    DEFAULT_CACHE_GB,
    CacheOption,
    folders_sampler,
    mix_file_sampler,
)
from re3.training.packed.recipe import PACKED_RECIPES
from re3.training.recipe import RECIPES

if TYPE_CHECKING:
    from re3.data.sampling import ClipSampler
    from re3.network.re3_lite import Re3Lite
    from re3.network.variants import Network
    from re3.training.trainer import Trainer


def train(
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            "-d",
            help="Folder with training data; repeat for several. Datasets of every format, clips "
            "with box files beside them, and annotated stills, are found in all folders below.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    mix: Annotated[
        Path | None,
        typer.Option(
            "--mix",
            help="YAML file that says what is trained on, in place of --data: sources with "
            "weights, share of simulated clips, augmentation (docs/training.md).",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    packed: Annotated[
        Path | None,
        typer.Option(
            help="Folder of shards that `re3 data pack` wrote, in place of --data: the whole of "
            "re3-lite learns, and crops are made on the device.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="Folder of the run. A run found there is resumed.",
            metavar="DIR",
        ),
    ] = Path("runs/re3-lite"),
    model: Annotated[
        str | None,
        typer.Option(
            help="Network to train: re3-lite, re3 (the paper's), or a model of its ablation study, "
            "lite-A to lite-K and paper-A to paper-K. Default: that of --init, or re3-lite.",
            show_default=False,
        ),
    ] = None,
    recipe_name: Annotated[
        str | None,
        typer.Option(
            "--recipe",
            help=f"Curriculum and optimiser: {', '.join(RECIPES)}, with --packed "
            f"{', '.join(PACKED_RECIPES)}, or a .yaml file with fields of a recipe; recipe.yaml in "
            "a run's folder is one. Default: frozen-trunk, with --packed gpu.",
            metavar="NAME|FILE",
            show_default=False,
        ),
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(
            help="With --packed: train for so long, with the learning rate fitted to it. Default: "
            "9, or as --iterations says.",
            min=0.01,
            show_default=False,
        ),
    ] = None,
    iterations: Annotated[
        int | None,
        typer.Option(
            help="With --packed: train for so many iterations, whatever time they take.",
            min=1,
            show_default=False,
        ),
    ] = None,
    recorded: Annotated[
        bool,
        typer.Option(
            "--cuda-graph",
            help="With --packed on a GPU: record a step as a CUDA graph and replay it.",
        ),
    ] = False,
    workers: Annotated[
        int, typer.Option(help="With --packed: processes that draw clips.", min=0)
    ] = 2,
    init: Annotated[
        Path | None,
        typer.Option(
            help="Start from these weights (.safetensors or .onnx) instead of fresh ones; those of "
            "one size of re3-lite are fitted to another that --model names.",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    validation: Annotated[
        Path | None,
        typer.Option(
            "--val",
            help="Folder with annotated clips; the weights with the best success AUC are kept.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    validation_clips: Annotated[
        int | None,
        typer.Option(
            "--val-clips",
            help="Validate on so many of those clips, evenly taken. Default: all.",
            min=1,
            show_default=False,
        ),
    ] = None,
    format_name: Annotated[
        str | None,
        typer.Option(
            "--format", help=f"{FORMAT_HELP} Not for --val.", metavar="NAME", show_default=False
        ),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave out the dataset (folder) of this name; repeat for several.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    length: Annotated[
        float, typer.Option(help="Times as many iterations as the recipe has.", min=0.0001)
    ] = 1.0,
    cache_gb: CacheOption = DEFAULT_CACHE_GB,
    seed: Annotated[
        int | None,
        typer.Option(
            help="Of weights, data and noise. Default: the recipe's.", min=0, show_default=False
        ),
    ] = None,
    threads: Annotated[int, typer.Option(help="Threads to use, of each process.", min=1)] = 2,
    device: Annotated[str, typer.Option(help="cpu, or cuda for GPUs.")] = "cpu",
    precision: Annotated[
        str | None,
        typer.Option(
            help="full, or mixed: 16 bits where they do. Default: mixed on GPUs only.",
            show_default=False,
        ),
    ] = None,
    compiled: Annotated[
        bool,
        typer.Option("--compile", help="Compile the pass with gradients: begins slowly."),
    ] = False,
) -> None:
    """Train re3-lite on your own videos and stills; killed runs resume where they were.

    Writes checkpoints, TensorBoard events, log.jsonl and, at the end,
    re3-lite.onnx and re3-lite.safetensors into the run's folder; with --val
    also re3-lite-best.onnx and -best.safetensors, the best on its clips.
    recipe.yaml, run.json and packages.txt there say what the run was made of.

    Several processes share every batch when torchrun starts them.

    Examples:

        re3 train --model re3-lite --data videos --data stills --val clips --out runs/mine

        torchrun --nproc-per-node 4 -m re3 train -d videos --device cuda -o runs/mine

        re3 train --packed packed --device cuda --compile --minutes 9 -o runs/mine
    """
    try:
        import torch

        from re3.apps.run_folder import note_start
        from re3.apps.validation import Validation
        from re3.network.quantize import is_quantized
        from re3.network.variants import trainable
        from re3.training.device import Device
        from re3.training.distributed import join_processes, leave_processes
        from re3.training.errors import TrainingError
        from re3.training.recipe_file import differences, find_recipe
        from re3.training.trainer import Trainer
    except ImportError as error:
        raise failed(
            f"training needs more than tracking does ({error}): pip install 're3[train]'"
        ) from error
    try:
        if packed is not None:
            if recorded and device != "cuda":
                raise ValueError("--cuda-graph is for GPUs; give --device cuda, or leave it out")
            if data or mix is not None or length != 1.0:
                raise ValueError(
                    "--packed has data and sampling of its own and is limited by --minutes or "
                    "--iterations; expected it without --data, --mix and --length"
                )
            run = PackedRun(
                folder=packed,
                out=out,
                recipe=recipe_name or "gpu",
                minutes=minutes,
                iterations=iterations,
                device=device,
                mixed=_mixed(precision, device),
                compiled=compiled,
                recorded=recorded,
                workers=workers,
                threads=threads,
                seed=seed,
                validation=validation,
                clips=validation_clips,
            )
            train_packed(run, _lite(_start(model, init), init))
            return
        if minutes is not None or iterations is not None:
            raise ValueError("--minutes and --iterations are for --packed; give --length instead")
        recipe_name = recipe_name or "frozen-trunk"
        recipe = find_recipe(recipe_name).scaled(length)
        if seed is not None:
            recipe = replace(recipe, seed=seed)
        mixed = _mixed(precision, device)
        Device(device, compiled=compiled)  # an unusable one is told before any process waits
        processes = join_processes(device)
        console = stderr()
        console.quiet = not processes.first
        torch.manual_seed(recipe.seed)
        network = trainable(_start(model, init))
        model = network.spec().name
        if init is None and not load_pretrained(network) and not recipe.learn_trunk:
            raise ValueError(
                f"no pretrained convolutions of {model!r} are at hand, and recipe {recipe_name} "
                "freezes them; take --recipe paper, or start from weights with --init"
            )
        if is_quantized(network):
            raise ValueError(
                f"{init} computes in eight bits and cannot be trained further; give the weights "
                "it was made from, such as those of re3-lite"
            )
        sampler = _sampler(data or [], set(exclude or []), format_name, mix, cache_gb)
        validate = None
        if validation is not None and processes.first:
            validate = Validation(validation, validation_clips)
        on = Device(device, processes.local_rank, mixed, compiled)
        trainer = Trainer(network, sampler, recipe, out, threads, on, processes)
        if trainer.earlier_recipe is not None:
            for line in differences(trainer.earlier_recipe, asdict(recipe)):
                console.print(f"note: the run goes on by another recipe: {line}", markup=False)
        if processes.first:
            note_start(out, recipe, trainer.iteration, device, processes.count)
            if mix is not None:
                (out / "mix.yaml").write_bytes(mix.read_bytes())
        console.print(
            f"{len(sampler.sequences)} tracks, {len(sampler.stills)} stills; iteration "
            f"{trainer.iteration} of {recipe.iterations}; run folder {out}"
        )
        with StopSignals() as stop, Report(console, recipe.iterations) as report:
            # To processes that have a signal already, torchrun passes it on: no second wish.
            stop.finishing = processes.count > 1
            trainer.train(report, validate, stop=stop, on_phase=report.phase)
        if trainer.iteration < recipe.iterations:
            console.print(
                f"stopped by {stop.name} at iteration {trainer.iteration}; run the same command "
                "to go on"
            )
            raise typer.Exit(stop.exit_code)
        if processes.first:
            _export(trainer, model, out)
        leave_processes(processes)
    except KeyboardInterrupt:  # a second Ctrl-C, or one before training
        stderr().print("interrupted; run the same command to go on from the last checkpoint")
        raise typer.Exit(INTERRUPTED) from None
    except (ImportError, OSError, ValueError, TrainingError) as error:
        raise failed(error) from error
    console.print(
        f"trained: {out / f'{model}.onnx'}; track with: re3 track CLIP --box X,Y,W,H "
        f"--model {out / f'{model}.onnx'}"
    )


def _start(model: str | None, init: Path | None) -> Network:
    """A network with fresh weights, or with those of a file."""
    from re3.network.variants import build
    from re3.network.weights import load_network

    if init is None:
        return build(model or "re3-lite")
    network = load_network(init)
    if model is not None and (other := _refitted(network, model)) is not None:
        return other
    if model not in (None, network.spec().name):
        raise ValueError(
            f"{init} holds weights of {network.spec().name!r}, not of {model!r}; give weights of "
            "that, or leave out --model"
        )
    return network


def _refitted(network: Network, model: str) -> Network | None:
    """Weights of one size of re3-lite as a start for another; None for other networks."""
    from re3.network.re3_lite import Re3Lite
    from re3.network.refit import refit_weights
    from re3.network.variants import build

    other = build(model)
    if not (isinstance(network, Re3Lite) and isinstance(other, Re3Lite)):
        return None
    if network.config.current == other.config.current:
        return None
    other.load_state_dict(refit_weights(network.state_dict(), network.config, other.config))
    return other


def _lite(network: Network, init: Path | None) -> Re3Lite:
    """A network that packed data can train, its backbone pretrained.

    Raises:
        ValueError: it is of another kind, or quantised.
    """
    from re3.network.quantize import is_quantized
    from re3.network.re3_lite import Re3Lite

    if not isinstance(network, Re3Lite) or is_quantized(network):
        raise ValueError(
            f"--packed cannot train {network.spec().name!r} as it is; expected re3-lite or another "
            "size of it, in full precision"
        )
    if init is None:
        load_pretrained(network)
    return network


def _mixed(precision: str | None, device: str) -> bool:
    """Whether to compute in mixed precision."""
    if precision not in (None, "full", "mixed"):
        raise ValueError(f"unknown precision {precision!r}; expected full or mixed")
    return device == "cuda" if precision is None else precision == "mixed"


def _export(trainer: Trainer, model: str, out: Path) -> None:
    """Write the networks for tracking: the one at the end, and the best by validation."""
    from re3.network.export import export_onnx
    from re3.network.weights import save_weights

    networks = {model: trainer.result, f"{model}-best": trainer.best_network()}
    for name, network in networks.items():
        if network is not None:
            export_onnx(network, out / f"{name}.onnx")
            save_weights(network, out / f"{name}.safetensors", half=True)


def _sampler(
    folders: list[Path],
    exclude: set[str],
    format_name: str | None,
    mix: Path | None = None,
    cache_gb: float = DEFAULT_CACHE_GB,
) -> ClipSampler:
    if mix is None:
        if not folders:
            raise ValueError("no data given; expected --data with folders, or --mix with a file")
        return folders_sampler(folders, exclude, format_name, cache_gb)
    if folders or exclude or format_name is not None:
        raise ValueError(
            "--mix says itself what is trained on; expected it without --data, --exclude and "
            "--format"
        )
    return mix_file_sampler(mix, cache_gb)
