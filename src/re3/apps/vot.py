"""`re3 vot`: the official VOT toolkit's supervised experiment, and our figures beside its own."""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.options import IntervalOption, PeersOption, SequencesOption, ShortTruthOption
from re3.apps.sequences import choose_sequences, read_sequences
from re3.data.lengths import check_lengths
from re3.data.sequence import Sequence
from re3.evaluation.peers import FIRST_BOX, find_tracker
from re3.evaluation.vot import STACKS, VotScores, VotStack, find_stack, score_vot
from re3.evaluation.vot_results import OfficialScores, read_analysis, read_runs
from re3.evaluation.vot_toolkit import ToolkitError, check_toolkit, run_toolkit
from re3.evaluation.vot_workspace import EXPERIMENT, write_config, write_sequences, write_trackers
from re3.models import DEFAULT_MODEL

PIPE_WIDTH = 160
ANALYSIS = "re3"
"""Name of the analysis and the report in the workspace."""


def vot(
    data: Annotated[
        list[Path],
        typer.Argument(
            help="Folders of datasets, in any format that `re3 eval` reads.",
            metavar="DATASET...",
            show_default=False,
        ),
    ],
    workspace: Annotated[
        Path,
        typer.Option(
            "--workspace",
            "-w",
            help="Folder of the toolkit's workspace; made where there is none, gone on with where "
            "there is.",
            metavar="DIR",
        ),
    ],
    tracker: Annotated[
        list[str] | None,
        typer.Option(
            "--tracker",
            "-t",
            help="A tracker to run, as `re3 eval` takes it; repeat for several. "
            f"Default: {DEFAULT_MODEL} and {FIRST_BOX}.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    stack: Annotated[
        str, typer.Option("--stack", help=f"The challenge: {', '.join(STACKS)}.", metavar="NAME")
    ] = "vot2016",
    sequences: SequencesOption = None,
    run: Annotated[
        bool,
        typer.Option("--run/--no-run", help="Run the trackers, or only analyse what there is."),
    ] = True,
    repetitions: Annotated[
        int | None,
        typer.Option(
            help="Runs of each sequence, instead of the stack's 15. The toolkit stops at three "
            "that are equal.",
            min=1,
            metavar="N",
            show_default=False,
        ),
    ] = None,
    interval: IntervalOption = None,
    short_truth: ShortTruthOption = False,
    peers: PeersOption = None,
    report: Annotated[
        bool, typer.Option("--report", help="Write the toolkit's HTML report as well.")
    ] = False,
) -> None:
    """Measure trackers with the official VOT toolkit: accuracy, robustness, EAO.

    Writes a workspace of the toolkit, lets the toolkit run its supervised
    experiment with every tracker over TraX and analyse it, and prints its
    figures beside ours from the same trajectories. What has been run is not
    run again. Needs the extra `vot` and the toolkit, see docs/vot.md.

    Example:

        re3 vot data/vot2016 -t re3-lite -t kcf --stack vot2016 --workspace out/vot
    """
    try:
        version = check_toolkit()
        chosen_stack = find_stack(stack, interval, repetitions)
        chosen = _complete(choose_sequences(read_sequences(data), sequences))
        if not short_truth:
            check_lengths(chosen)
        asked = _trackers(tracker or [DEFAULT_MODEL, FIRST_BOX], peers)
        write_config(workspace, chosen_stack)
        named = _write_sequences(workspace, chosen)
        names = write_trackers(workspace, list(asked.items()), peers)
        if run:
            _run(workspace, names)
        ours = {
            identifier: score_vot(
                read_runs(workspace, identifier, named, chosen_stack.repetitions), chosen_stack
            )
            for identifier in names
        }
        official = _analyse(workspace, list(names), chosen_stack, report)
        rows = [(name, official[i], ours[i]) for i, name in names.items()]
        polygons = sum(sequence.polygons is not None for sequence in chosen)
        _show(rows, chosen_stack, len(named), polygons, version)
        if report:
            stderr().print(f"report: {workspace}/reports/{ANALYSIS}/report.html", markup=False)
    except (ToolkitError, ValueError, OSError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        stderr().print(
            f"interrupted; finished runs are in {workspace}, the same command goes on", markup=False
        )
        raise typer.Exit(INTERRUPTED) from None


def _trackers(asked: list[str], peers: Path | None) -> dict[str, str]:
    """What was asked for by the name it is reported by, each once."""
    named: dict[str, str] = {}
    for one in asked:
        info = find_tracker(one, peers)
        if info.factory is None:
            raise ValueError(f"{one} cannot be run: {info.about}; expected a tracker")
        if named.setdefault(info.name, one) != one:
            raise ValueError(
                f"{named[info.name]!r} and {one!r} are both reported as {info.name!r}; give one "
                "a name of its own as NAME=TRACKER"
            )
    return named


def _complete(sequences: list[Sequence]) -> list[Sequence]:
    """The sequences with a box in every frame; says which are left out."""
    complete = [sequence for sequence in sequences if sequence.annotated.all()]
    left_out = [sequence.name for sequence in sequences if not sequence.annotated.all()]
    if left_out:
        stderr().print(
            f"note: left out, for frames without a box, which the toolkit would count as "
            f"failures: {', '.join(left_out)}",
            markup=False,
        )
    if not complete:
        raise ValueError("no sequence with a box in every frame; the toolkit needs one or more")
    return complete


def _write_sequences(workspace: Path, sequences: list[Sequence]) -> list[str]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("writing frames", total=sum(map(len, sequences)))
        return list(
            write_sequences(workspace, sequences, lambda frames: bar.update(task, completed=frames))
        )


def _run(workspace: Path, names: dict[str, str]) -> None:
    log = workspace / "toolkit.log"
    for identifier, name in names.items():
        with Console(stderr=True).status(f"the toolkit runs {name}; see {log}"):
            run_toolkit(
                "evaluate", identifier, "--experiments", EXPERIMENT, workspace=workspace, log=log
            )


def _analyse(
    workspace: Path, identifiers: list[str], stack: VotStack, report: bool
) -> dict[str, OfficialScores]:
    log = workspace / "toolkit.log"
    options = (*identifiers, "--experiments", EXPERIMENT, "--name", ANALYSIS)
    with Console(stderr=True).status(f"the toolkit analyses; see {log}"):
        run_toolkit("analysis", *options, workspace=workspace, log=log)
        if report:
            run_toolkit("report", *options, workspace=workspace, log=log)
    path = workspace / "analysis" / f"{ANALYSIS}.json"
    return dict(zip(identifiers, read_analysis(path, identifiers, stack), strict=True))


def _show(
    rows: list[tuple[str, OfficialScores, VotScores]],
    stack: VotStack,
    count: int,
    polygons: int,
    version: str,
) -> None:
    # A file or a pipe has no width to keep to; without one Rich would cut tables at 80 columns.
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    table = Table(
        title=f"{stack.name}, supervised experiment, {count} sequences",
        title_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("tracker", overflow="fold")
    table.add_column("figures by", no_wrap=True)
    for heading in ("accuracy", "robustness", "reliability", "failures", "EAO"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, official, ours in rows:
        table.add_row(name, f"vot-toolkit {version}", *_figures(official))
        table.add_row("", "re3", *_figures(ours))
    console.print(table)
    for note in [*_notes(rows, stack), _truth_note(count, polygons)]:
        console.print(f"note: {note}", markup=False, highlight=False)


def _figures(scores: OfficialScores | VotScores) -> list[str]:
    values = (
        scores.accuracy,
        scores.robustness,
        scores.reliability,
        scores.failures,
        scores.eao,
    )
    return ["-" if value is None or math.isnan(value) else f"{value:.4f}" for value in values]


def _notes(rows: list[tuple[str, OfficialScores, VotScores]], stack: VotStack) -> list[str]:
    notes = [
        "robustness is failures a sequence, weighted by length; reliability exp(-S failures / "
        f"frames) with S {stack.sensitivity:g}",
        f"toolkit and re3 differ by {largest_difference(rows):.1e} at most",
    ]
    longest = max(len(ours.curve) for _, _, ours in rows)
    if stack.interval is not None and longest <= stack.interval[0]:
        notes.append(
            f"no EAO: the longest stretch has {longest} frames and {stack.name} averages from "
            f"{stack.interval[0]} on; give --interval LOW,HIGH"
        )
    return notes


def _truth_note(count: int, polygons: int) -> str:
    if not polygons:
        return "the truth is upright boxes; a challenge with polygons or masks has other figures"
    others = "" if polygons == count else ", upright boxes in the others"
    return f"the truth is polygons in {polygons} of {count} sequences{others}"


def largest_difference(rows: list[tuple[str, OfficialScores, VotScores]]) -> float:
    """The largest difference of a figure that both the toolkit and we have."""
    return max(
        abs(theirs - getattr(ours, figure))
        for _, official, ours in rows
        for figure, theirs in dataclasses.asdict(official).items()
        if theirs is not None and not math.isnan(theirs)
    )
