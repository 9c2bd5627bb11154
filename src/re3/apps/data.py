"""`re3 data`: look at datasets before anything is trained or measured on them."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.data_label import label
from re3.apps.data_look import show, stats
from re3.apps.data_pack import pack
from re3.data.formats import FORMATS
from re3.data.formats.check import Finding, check_dataset
from re3.data.still_formats import STILL_FORMATS
from re3.data.still_formats.check import (
    StillsReport,
    check_stills,
    is_still_format,
    still_folders,
)

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

        re3 data pack mix.yaml --out packed

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
            help="Read it as this: "
            + ", ".join(known.name for known in (*FORMATS, *STILL_FORMATS))
            + ". "
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

    Gaps are frames without a box, sizes in pixels. Of stills, pictures with
    something wrong are listed. What stands after ! makes a sequence or a
    picture unusable, and the exit code is then 1; the rest is worth a look.

    Examples:

        re3 data check GOT-10k/val --frames

        re3 data check coco
    """
    try:
        name, findings, stills = _checked(folder, format, frames)
        formats = [name] if name else []
    except (ValueError, OSError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        stderr().print("interrupted", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    if as_json:
        document: dict[str, Any] = {
            "folder": str(folder),
            "format": " and ".join([*formats, *(stills.formats if stills is not None else [])]),
            "sequences": list(map(asdict, findings)),
        }
        if stills is not None:
            document["stills"] = asdict(stills)
        typer.echo(json.dumps(document, indent=2, ensure_ascii=False))
    else:
        if findings:
            _show(folder, name, findings)
        if stills is not None:
            _show_stills(folder, stills)
    broken = any(finding.errors for finding in findings)
    if broken or (stills is not None and any(finding.errors for finding in stills.findings)):
        raise typer.Exit(UNUSABLE)


def _checked(
    folder: Path, format: str | None, decode: bool
) -> tuple[str, list[Finding], StillsReport | None]:
    """Format and findings of the sequences, without any an empty name, and the report of stills
    where there are any."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("looking", total=None)

        def advance(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        name = ""
        findings: list[Finding] = []
        missing: ValueError | None = None
        if not is_still_format(format):
            try:
                name, findings = check_dataset(folder, format, decode=decode, on_progress=advance)
            except ValueError as error:
                missing = error
        if missing is not None and format is not None:
            raise missing
        try:
            found = still_folders(folder, format) if format is None or not name else []
        except ValueError:
            if not name:
                raise
            found = []
        stills = check_stills(found, decode=decode, on_progress=advance) if found else None
        if stills is None and missing is not None:
            known = ", ".join(known.name for known in STILL_FORMATS)
            raise ValueError(f"{missing}\nnor annotated stills ({known})") from missing
    return name, findings, stills


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


def _show_stills(folder: Path, report: StillsReport) -> None:
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    if report.findings:
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        table.add_column("picture", overflow="fold")
        table.add_column("problems", overflow="fold")
        for finding in report.findings:
            problems = [*(f"! {error}" for error in finding.errors), *finding.warnings]
            table.add_row(escape(finding.name), escape("; ".join(problems)))
        console.print(table)
    broken = sum(bool(finding.errors) for finding in report.findings)
    console.print(
        f"{folder}: stills in the format {' and '.join(report.formats)}, {report.pictures} "
        f"pictures, {report.objects} objects, {report.outlines} of them with an outline; {broken} "
        f"unusable, {len(report.findings) - broken} with something odd",
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
data.command()(pack)
data.command()(label)
