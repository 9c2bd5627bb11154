"""`re3 qualitative`: a grid of tracked frames with the truth beside them (Re3, Fig. 7)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from re3.apps.console import failed, stderr
from re3.apps.options import PeersOption
from re3.models import DEFAULT_MODEL


def qualitative(
    dataset: Annotated[
        Path, typer.Argument(help="Folder of annotated clips, of any dataset `re3 eval` reads.")
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Picture to write: .png, .pdf or .svg.", metavar="FILE"),
    ],
    tracker: Annotated[
        str,
        typer.Option("--tracker", "-t", help="As for `re3 eval`: a name or a model file."),
    ] = DEFAULT_MODEL,
    frame: Annotated[
        int,
        typer.Option(
            help="Frame to show beside the first, which is 1; of shorter tracks the last.", min=2
        ),
    ] = 100,
    sequences: Annotated[
        str | None,
        typer.Option(
            "--sequences",
            "-s",
            help="Only these, separated by commas, in this order.",
            metavar="A,B",
            show_default=False,
        ),
    ] = None,
    columns: Annotated[int, typer.Option(help="Sequences in a row.", min=1)] = 3,
    peers: PeersOption = None,
) -> None:
    """Show the first and the 100th frame of each sequence: truth green, tracker red.

    Each sequence is tracked as far as it is shown. Needs the extra "report".

    Example:

        re3 qualitative data/davis -t re3-lite --out fig7.png
    """
    from re3.data.formats import read_dataset
    from re3.evaluation.peers import find_tracker
    from re3.evaluation.plots_style import check_suffix, require, save
    from re3.evaluation.qualitative import make_example, qualitative_plot

    try:
        # Before anything is tracked.
        check_suffix(out)
        require("matplotlib")
        factory = find_tracker(tracker, peers).factory
        assert factory is not None, "find_tracker gives available ones"
        chosen = {sequence.name: sequence for sequence in read_dataset(dataset)}
        if sequences is not None:
            asked = [name.strip() for name in sequences.split(",") if name.strip()]
            if unknown := [name for name in asked if name not in chosen]:
                raise ValueError(
                    f"no sequence is called {', '.join(unknown)}; there are {', '.join(chosen)}"
                )
            if not asked:
                raise ValueError(f"--sequences {sequences!r} names none; expected names")
            chosen = {name: chosen[name] for name in asked}
        examples = []
        bar = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        with Progress(*bar, console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task("tracking", total=len(chosen))
            for name, sequence in chosen.items():
                progress.update(task, description=name)
                examples.append(make_example(sequence, factory, frame))
                progress.advance(task)
        save(qualitative_plot(examples, columns, tracker), out)
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    stderr().print(f"{out}: {len(examples)} sequences", markup=False)
