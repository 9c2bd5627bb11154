"""`re3 data`: look at datasets before anything is trained or measured on them."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.data_label import label
from re3.apps.data_look import show, stats
from re3.data.formats import FORMATS
from re3.data.formats.check import Finding, check_dataset

PIPE_WIDTH = 160
UNUSABLE = 1
"""Exit code after a check that found a sequence that cannot be used."""

data = typer.Typer(name="data", no_args_is_help=True)


@data.callback()
def _root() -> None:
    """Check what datasets hold, and look at what training makes of them.

    Examples:

        re3 data check OTB100

        re3 data stats mix.yaml --out stats.png

        re3 data show mix.yaml --out sheet.png

        re3 data label footage --teacher fear-xs --out tracks
    """


@data.command()
def check(
    folder: Annotated[
        Path, typer.Argument(help="A dataset's folder, as it is unpacked.", metavar="DIR")
    ],
    format: Annotated[
        str | None,
        typer.Option(
            "--format",
            "-f",
            help="Read it as this: " + ", ".join(known.name for known in FORMATS) + ". "
            "Default: what its structure looks like.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    frames: Annotated[
        bool, typer.Option("--frames", help="Also decode every frame, to find broken ones.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON in place of the table.")
    ] = False,
) -> None:
    """List what a dataset holds and what is wrong with it; nothing is tracked.

    Gaps are frames without a box, sizes in pixels. What stands after ! makes
    a sequence unusable, and the exit code is then 1; the rest is worth a look.

    Example:

        re3 data check GOT-10k/val --frames
    """
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    try:
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("clips", total=None)
            name, findings = check_dataset(
                folder,
                format,
                decode=frames,
                on_progress=lambda done, total: bar.update(task, completed=done, total=total),
            )
    except (ValueError, OSError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        stderr().print("interrupted", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    if as_json:
        document = {"folder": str(folder), "format": name, "sequences": list(map(asdict, findings))}
        typer.echo(json.dumps(document, indent=2, ensure_ascii=False))
    else:
        _show(folder, name, findings)
    if any(finding.errors for finding in findings):
        raise typer.Exit(UNUSABLE)


def _show(folder: Path, name: str, findings: list[Finding]) -> None:
    # A file or a pipe has no width to keep to; without one Rich would fold the table at 80.
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("sequence", overflow="fold")
    for heading in ("frames", "boxes", "gaps", "occluded", "median size"):
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in ("attributes", "problems"):
        table.add_column(heading, overflow="fold")
    for finding in findings:
        table.add_row(*_row(finding))
    console.print(table)
    frames = sum(finding.frames for finding in findings)
    broken = sum(bool(finding.errors) for finding in findings)
    odd = sum(bool(finding.warnings) and not finding.errors for finding in findings)
    console.print(
        f"{folder}: format {name}, {len(findings)} sequences, {frames} frames; {broken} unusable, "
        f"{odd} with something odd",
        markup=False,
    )


def _row(finding: Finding) -> list[str]:
    size = finding.median_size
    problems = [*(f"! {error}" for error in finding.errors), *finding.warnings]
    return [
        escape(finding.name),
        str(finding.frames or "-"),
        str(finding.boxes or "-"),
        str(finding.gaps) if finding.frames else "-",
        "-" if finding.occluded is None else str(finding.occluded),
        "-" if size is None else f"{size[0]:.0f} x {size[1]:.0f}",
        escape(", ".join(finding.attributes)),
        escape("; ".join(problems)),
    ]


data.command()(stats)
data.command()(show)
data.command()(label)
