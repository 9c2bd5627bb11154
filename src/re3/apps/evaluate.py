"""`re3 eval`: run trackers over annotated clips and print how well and how fast they follow."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.data.plain import read_folder
from re3.data.sequence import Sequence
from re3.evaluation.environment import Environment
from re3.evaluation.peers import FIRST_BOX, TrackerInfo, available_trackers, find_tracker
from re3.evaluation.report import Report, remarks, to_json, to_markdown, to_tables
from re3.evaluation.runner import Progress, SequenceResult, run
from re3.models import DEFAULT_MODEL

PIPE_WIDTH = 160


def evaluate(
    data: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Folders with annotated clips: videos or folders of images, each with a .txt or "
            ".jsonl file of boxes beside it. Searched with all folders below.",
            metavar="DATA...",
            show_default=False,
        ),
    ] = None,
    tracker: Annotated[
        list[str] | None,
        typer.Option(
            "--tracker",
            "-t",
            help="A tracker to run; repeat for several. A model's name, a model file, "
            "NAME=MODEL_FILE, or one that --list names. Default: the model and first-box.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            "-m",
            help="Our model: a name or a file; runs first, before the trackers named. "
            f"Default: {DEFAULT_MODEL}, where no tracker is named.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for result boxes (DATASET/TRACKER/SEQUENCE.txt), report.md and "
            "report.json.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Take over results that --out already holds.")
    ] = False,
    sequences: Annotated[
        str | None,
        typer.Option(
            "--sequences",
            "-s",
            help="Only these, separated by commas; a clip's name stands for all its tracks.",
            metavar="A,B",
            show_default=False,
        ),
    ] = None,
    peers: Annotated[
        Path | None,
        typer.Option(
            "--peers",
            help="Folder with the files of peer trackers (nanotrack/v2, nanotrack/v3). Default: "
            "the environment's RE3_PEERS, or ../shared/peers.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option(
            "--json", help="Write the report as JSON.", metavar="FILE", show_default=False
        ),
    ] = None,
    list_trackers: Annotated[
        bool, typer.Option("--list", help="List the trackers known by name and exit.")
    ] = False,
) -> None:
    """Measure trackers on annotated clips: accuracy (AUC, precision) and speed.

    One-pass evaluation: every tracker gets the first annotated box of a
    sequence and follows it to the end, without another hint. Tables go to
    stdout, progress to stderr.

    Example:

        re3 eval data/davis -t re3-lite -t kcf -t csrt -t first-box --out results
    """
    try:
        if list_trackers:
            Console().print(_tracker_table(available_trackers(peers)))
            return
        chosen = _choose(_read(data or []), sequences)
        trackers = [find_tracker(name, peers) for name in _asked(tracker or [], model)]
        environment = Environment.here()
        results = _run(trackers, chosen, out, resume)
        report = Report(
            command=shlex.join(["re3", *sys.argv[1:]]),
            data=tuple(str(folder) for folder in data or []),
            environment=environment,
            results=results,
        )
        _show(report)
        _write(report, out, json_file)
    except (ValueError, OSError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        kept = f"; finished tracks are in {out}, go on with --resume" if out is not None else ""
        stderr().print(f"interrupted{kept}", markup=False)
        raise typer.Exit(INTERRUPTED) from None


def _asked(trackers: list[str], model: str | None) -> list[str]:
    """Names of the trackers to run, each once, in order."""
    if model is not None:
        trackers = [model, *(trackers or [FIRST_BOX])]
    return list(dict.fromkeys(trackers or [DEFAULT_MODEL, FIRST_BOX]))


def _read(folders: list[Path]) -> list[Sequence]:
    if not folders:
        raise ValueError("no data given; expected folders with annotated clips, see --help")
    return [sequence for folder in folders for sequence in read_folder(folder)]


def _choose(sequences: list[Sequence], names: str | None) -> list[Sequence]:
    """The sequences named, in their own order; all without names."""
    if names is None:
        return sequences
    wanted = {name.strip() for name in names.split(",") if name.strip()}
    chosen = [s for s in sequences if not wanted.isdisjoint(_names_of(s))]
    known = {name for sequence in sequences for name in _names_of(sequence)}
    if unknown := sorted(wanted - known):
        raise ValueError(
            f"no sequence is called {', '.join(unknown)}; there are "
            + ", ".join(sequence.name for sequence in sequences)
        )
    if not chosen:
        raise ValueError(f"--sequences {names!r} names none; expected names separated by commas")
    return chosen


def _names_of(sequence: Sequence) -> set[str]:
    return {sequence.name, sequence.name.partition("/")[0]}


def _run(
    trackers: list[TrackerInfo], sequences: list[Sequence], out: Path | None, resume: bool
) -> list[SequenceResult]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with ProgressBar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def advance(progress: Progress) -> None:
            bar.update(
                task,
                description=f"{progress.sequence.name} · {progress.tracker}",
                completed=progress.frames_before + progress.frames,
                total=progress.frames_total,
            )

        return run(trackers, sequences, out=out, resume=resume, on_progress=advance)


def _show(report: Report) -> None:
    # A file or a pipe has no width to keep to; without one Rich would cut tables at 80 columns.
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    for table in to_tables(report):
        console.print(table)
    for note in remarks(report):
        console.print(f"note: {note}", markup=False, highlight=False)


def _write(report: Report, out: Path | None, json_file: Path | None) -> None:
    if out is not None:
        (out / "report.md").write_text(to_markdown(report), encoding="utf-8")
        (out / "report.json").write_text(to_json(report), encoding="utf-8")
    if json_file is not None:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(to_json(report), encoding="utf-8")


def _tracker_table(infos: list[TrackerInfo]) -> Table:
    table = Table("tracker", "what it is", "available")
    for info in infos:
        table.add_row(info.name, info.about, info.missing or "yes")
    return table
