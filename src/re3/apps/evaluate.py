"""`re3 eval`: run trackers over annotated clips and print how well and how fast they follow."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.evaluate_bars import Bars
from re3.apps.evaluate_tables import show_run, show_trackers
from re3.apps.exported_weights import with_exported_weights
from re3.apps.options import IntervalOption, PeersOption, SequencesOption, ShortTruthOption
from re3.apps.sequences import FORMAT_HELP, choose_sequences, read_sequences
from re3.data.lengths import check_lengths
from re3.data.sequence import Sequence
from re3.evaluation.environment import Environment
from re3.evaluation.peers import FIRST_BOX, TrackerInfo, available_trackers, find_tracker
from re3.evaluation.protocols import DEFAULT_STACK, PROTOCOLS, find_protocol, with_otb_rules
from re3.evaluation.published import looks_shifted
from re3.evaluation.report import write_reports
from re3.evaluation.report_data import results_json
from re3.evaluation.result_files import write_whole
from re3.evaluation.runner import TIMEOUT, run
from re3.evaluation.summary import Run
from re3.evaluation.vot import STACKS, find_stack
from re3.models import DEFAULT_MODEL

SOMETHING_FAILED = 1
"""Exit code of a run that went to its end, but in which a tracker or a sequence failed."""


def evaluate(
    data: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Folders of datasets, in any format of --format; or of annotated clips: videos "
            "or folders of images, each with a .txt or .jsonl file of boxes beside it.",
            metavar="DATA...",
            show_default=False,
        ),
    ] = None,
    tracker: Annotated[
        list[str] | None,
        typer.Option(
            "--tracker",
            "-t",
            help="A tracker to run; repeat for several. A model's name or file, with options "
            "after it (re3-lite@no-reset, re3-lite@torch), one that --list names, trax:COMMAND, "
            "python:MODULE:CLASS, or published:FOLDER of result boxes; NAME= before it names it "
            "in the report. Default: the model and first-box.",
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
            help="Folder for result boxes (DATASET/TRACKER/SEQUENCE.txt), results.json, "
            "results.csv, report.md, report.html and plots; in a folder vot or ablation of it for "
            "those protocols.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Take over results that --out already holds.")
    ] = False,
    protocol: Annotated[
        str,
        typer.Option(
            "--protocol",
            "-p",
            help="How trackers are run and judged: ope, one pass, means over sequences; "
            "tre, the same from 20 frames of each clip; sre, from 12 boxes beside the truth; "
            "starts, a fixed subset of both in one figure with its standard error; "
            "imagenet-vid, one pass, all boxes together (Re3, sec. IV-B); ablation, started again "
            "after a drop (Re3, Table I); hidden, one pass with the object hidden for a while; "
            "framed, one pass from boxes about a part of the object or more than it; "
            "vot, supervised (accuracy, robustness, EAO).",
            metavar="|".join(PROTOCOLS),
        ),
    ] = "ope",
    vot_stack: Annotated[
        str,
        typer.Option(
            "--vot-stack",
            help="With --protocol vot, the challenge whose settings are taken: "
            f"{', '.join(STACKS)}.",
            metavar="NAME",
        ),
    ] = DEFAULT_STACK,
    interval: IntervalOption = None,
    otb_rules: Annotated[
        bool,
        typer.Option(
            "--otb-rules",
            help="Count frames exactly as OTB's toolkit does: a tracker's last box is repeated "
            "where it has none, and true boxes with x or y at or below 0 are compared with "
            "nothing. With ope, tre or sre.",
        ),
    ] = False,
    published_from: Annotated[
        int,
        typer.Option(
            "--published-from",
            help="What published:FOLDER boxes call the first column and row of an image: 0, or 1 "
            "as in OTB's own files and most boxes published for it.",
            min=0,
            max=1,
            metavar="0|1",
        ),
    ] = 0,
    repeat: Annotated[
        int,
        typer.Option(
            "--repeat",
            help="Run everything so often, for trackers that draw numbers; figures are the mean, "
            "with their standard deviation.",
            min=1,
            metavar="N",
        ),
    ] = 1,
    occluded: Annotated[
        bool,
        typer.Option(
            "--occluded",
            help="Also compare all frames with those the dataset marks as occluded (Re3, sec. "
            "IV-E): with ope or imagenet-vid success, with vot the expected overlap.",
        ),
    ] = False,
    format_name: Annotated[
        str | None,
        typer.Option("--format", help=FORMAT_HELP, metavar="NAME", show_default=False),
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs",
            "-j",
            help="Sequences that run at the same time, each in a process of its own. The boxes do "
            "not depend on it, the speeds do: measure those with 1. 0: in this process, where a "
            "tracker that hangs cannot be stopped.",
            min=0,
            metavar="N",
        ),
    ] = 1,
    timeout: Annotated[
        float,
        typer.Option(
            "--timeout",
            help="Seconds a tracker may take for a frame; then it is stopped, the sequence has "
            "failed and the run goes on.",
            metavar="SECONDS",
        ),
    ] = TIMEOUT,
    sequences: SequencesOption = None,
    short_truth: ShortTruthOption = False,
    peers: PeersOption = None,
    json_file: Annotated[
        Path | None,
        typer.Option(
            "--json",
            help="Write what results.json holds to this file, also without --out.",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    list_trackers: Annotated[
        bool, typer.Option("--list", help="List the trackers known by name and exit.")
    ] = False,
) -> None:
    """Measure trackers on annotated clips: accuracy and speed.

    One-pass evaluation, unless --protocol says otherwise: every tracker gets
    the first annotated box of a sequence and follows it to the end, without
    another hint. Tables go to stdout, progress to stderr.

    A tracker that raises, hangs or gives no box, and a sequence that cannot
    be read, is reported as failed, and the run goes on; the exit code is then
    1. A run that was stopped goes on with --out and --resume.

    Examples:

        re3 eval data/davis -t re3-lite -t kcf -t csrt -t first-box --out results

        re3 eval data/vot2016 --protocol vot -t re3-lite -t opencv:csrt --jobs 4

        re3 eval data/otb -t re3-lite -t published:data/published/otb/SiamFC
    """
    try:
        if list_trackers:
            show_trackers(available_trackers(peers))
            return
        if interval is not None and protocol != "vot":
            raise ValueError(f"--interval is of --protocol vot, not of {protocol}; leave it out")
        chosen_protocol = find_protocol(
            protocol, find_stack(vot_stack, interval), occluded=occluded
        )
        if occluded and not chosen_protocol.one_pass and protocol != "vot":
            raise ValueError(
                f"--occluded compares frames of one pass, or expected overlap in vot; with "
                f"--protocol {protocol} the tracker is started again. Take ope, imagenet-vid or vot"
            )
        chosen = choose_sequences(read_sequences(data or [], format_name), sequences)
        if not short_truth:
            check_lengths(chosen)
        if chosen_protocol.prepare is not None:
            chosen = chosen_protocol.prepare(chosen)
        trackers = [find_tracker(name, peers) for name in _asked(tracker or [], model)]
        trackers = [replace(info, first_pixel=published_from) for info in trackers]
        published = [info.name for info in trackers if info.published is not None]
        if published and chosen_protocol.prepare is not None:
            raise ValueError(
                f"{published[0]} is published boxes of the clips as they are, which --protocol "
                f"{protocol} changes; leave it out, or take the protocol ope or imagenet-vid"
            )
        if occluded and all(sequence.occluded is None for sequence in chosen):
            raise ValueError(
                "--occluded needs data that says which frames are occluded, and none of the "
                f"{len(chosen)} sequences does"
            )
        if otb_rules:
            chosen_protocol = with_otb_rules(chosen_protocol)
        environment = Environment.here()
        if out is not None and not chosen_protocol.one_pass:
            # Trajectories with restarts must not be taken for those of one pass.
            out = out / chosen_protocol.name
        with TemporaryDirectory(prefix="re3-eval-") as exported, Bars() as bars:
            results = run(
                with_exported_weights(trackers, Path(exported)),
                chosen,
                out=out,
                resume=resume,
                on_progress=bars.advance,
                supervised=chosen_protocol.supervised,
                repeats=repeat,
                jobs=jobs,
                timeout=timeout,
                otb_rules=otb_rules,
            )
        done = Run(
            command=shlex.join(["re3", *sys.argv[1:]]),
            data=tuple(str(folder) for folder in data or []),
            environment=environment,
            protocol=chosen_protocol,
            jobs=jobs,
            results=results,
            remarks=_remarks(trackers, chosen),
        )
        show_run(done, occluded=occluded)
        if json_file is not None:
            write_whole(json_file, results_json(done))
        if out is not None:
            _write_reports(done, out)
    except (ValueError, OSError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        kept = f"; finished tracks are in {out}, go on with --resume" if out is not None else ""
        stderr().print(f"interrupted{kept}", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    if any(result.track.failure is not None for result in results):
        raise typer.Exit(SOMETHING_FAILED)


def _remarks(trackers: list[TrackerInfo], sequences: list[Sequence]) -> tuple[str, ...]:
    """What to say of published boxes that seem to be read one pixel beside their place."""
    return tuple(
        f"the boxes of {info.name} begin one pixel beside the truth, across and down; if they "
        f"count pixels from {1 - info.first_pixel}, give --published-from {1 - info.first_pixel}"
        for info in trackers
        if info.published is not None and looks_shifted(info.published, sequences, info.first_pixel)
    )


def _asked(trackers: list[str], model: str | None) -> list[str]:
    """Names of the trackers to run, each once, in order."""
    if model is not None:
        trackers = [model, *(trackers or [FIRST_BOX])]
    return list(dict.fromkeys(trackers or [DEFAULT_MODEL, FIRST_BOX]))


def _write_reports(done: Run, out: Path) -> None:
    try:
        write_reports(done, out)
    except ImportError as error:
        stderr().print(f"no page and no plots: {error}", markup=False)
