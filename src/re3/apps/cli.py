"""The command line `re3`: one thin app, its commands in modules of their own."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from re3 import __version__
from re3.apps.ablate import ablate
from re3.apps.bench import bench
from re3.apps.compare import compare
from re3.apps.data import data
from re3.apps.evaluate import evaluate
from re3.apps.export import export
from re3.apps.qualitative import qualitative
from re3.apps.serve import serve
from re3.apps.simulate import simulate
from re3.apps.track import track
from re3.apps.train import train
from re3.apps.tsne import tsne
from re3.apps.vot import vot
from re3.apps.weights import weights
from re3.models import list_models

PIPE_WIDTH = 160

app = typer.Typer(
    name="re3",
    help="Track any object in video, in real time, on a CPU.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"re3 {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Track any object in video, in real time, on a CPU.

    Start with: re3 track clip.mp4 --box 120,80,60,140 --out tracked.mp4
    """


def models() -> None:
    """List the models with size, accuracy and speed.

    Accuracy and speed are what the model's card says was measured; the card names the command,
    the data and the machine.

    Example:

        re3 models
    """
    table = Table()
    for heading in ("model", "weights", "parameters", "crop", "accuracy", "speed", "what it is"):
        table.add_column(heading, overflow="fold")
    for card in list_models():
        table.add_row(
            card.name,
            f"{card.size_bytes / 1e6:.1f} MB" if card.size_bytes else "none shipped",
            f"{card.parameters / 1e6:.1f} M",
            f"{card.crop_size} px",
            ", ".join(f"{name} {value:.3f}" for name, value in card.accuracy.items()) or "-",
            f"{card.speed_fps:.0f} FPS" if card.speed_fps else "-",
            card.description,
        )
    # A file or a pipe has no width to keep to; without one Rich would fold the table at 80.
    Console(width=None if sys.stdout.isatty() else PIPE_WIDTH).print(table)


# As `re3 --help` lists them: track, compare, train; apps of several commands come last.
app.command()(track)
app.command()(serve)
app.command()(models)
app.command(name="eval")(evaluate)
app.command()(compare)
app.command()(bench)
app.command()(vot)
app.command()(qualitative)
app.command()(tsne)
app.command()(train)
app.command()(ablate)
app.command()(simulate)
app.command()(export)
app.add_typer(data)
app.add_typer(weights)


def main() -> None:
    """Entry point of the `re3` script."""
    app()
