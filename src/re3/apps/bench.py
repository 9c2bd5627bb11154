"""`re3 bench`: speed, memory and size on this machine, with other trackers beside."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from rich.console import Console

from re3.apps.console import failed, stderr
from re3.apps.evaluate_tables import PIPE_WIDTH, rich_table
from re3.benchmark.advice import advice
from re3.benchmark.contenders import Entry, our_entries
from re3.benchmark.footage import SIZE, Footage, made_footage, read_footage
from re3.benchmark.report import as_json, tables
from re3.benchmark.study import Plan, Study, run_study
from re3.evaluation.peers import available_trackers, find_tracker
from re3.evaluation.result_files import write_whole
from re3.models import DEFAULT_MODEL, FAST_MODEL

FRAMES_KEPT = 120
"""Frames held in memory: 110 MB at 640 x 480."""

DEFAULT_PEERS = ("kcf", "csrt", "nanotrack-v2", "fear-xs")
"""Those of them that can be run here are."""


def bench(
    source: Annotated[
        str | None,
        typer.Option(
            "--source",
            help="Frames of your own: a video file or a folder of images; with --box. "
            "Default: frames that are made.",
            metavar="SOURCE",
            show_default=False,
        ),
    ] = None,
    box: Annotated[
        str | None,
        typer.Option(
            "--box",
            "-b",
            help="The object in the first frame of --source: left, top, width, height in pixels.",
            metavar="X,Y,W,H",
            show_default=False,
        ),
    ] = None,
    size: Annotated[
        str,
        typer.Option(help="Frames are scaled to this before; `own` leaves them.", metavar="WxH"),
    ] = f"{SIZE[0]}x{SIZE[1]}",
    model: Annotated[
        str,
        typer.Option("--model", "-m", help="Models by name or file, several with commas."),
    ] = f"{FAST_MODEL},{DEFAULT_MODEL}",
    engines: Annotated[
        str, typer.Option("--engines", help="Engines, such as onnx,torch.", metavar="A,B")
    ] = "auto",
    threads: Annotated[
        str,
        typer.Option(
            "--threads", help="Numbers of threads, such as 1,2; 0: one a core.", metavar="N,N"
        ),
    ] = "0",
    objects: Annotated[
        str, typer.Option("--objects", help="Numbers of objects.", metavar="N,N")
    ] = "1,2,5,10,20,50",
    peers: Annotated[
        str | None,
        typer.Option(
            "--peers",
            "-t",
            help="Trackers beside ours, named as `re3 eval --list` does; `none` for none. "
            f"Default: {', '.join(DEFAULT_PEERS)}, where they are.",
            metavar="A,B",
            show_default=False,
        ),
    ] = None,
    peer_files: Annotated[
        Path | None,
        typer.Option(
            help="Folder with the files of peers. Default: the environment's RE3_PEERS, or "
            "../shared/peers.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    crop_sizes: Annotated[
        str | None,
        typer.Option(
            "--crop-sizes",
            help="Also measure re3-lite, untrained, with crops of these sides, multiples of 48; "
            "needs torch.",
            metavar="N,N",
            show_default=False,
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(help="Turns of each tracker.", min=1)] = 5,
    frames: Annotated[
        int, typer.Option(help="Updates a turn with one object; with several, fewer.", min=1)
    ] = 40,
    memory: Annotated[bool, typer.Option(help="Measure memory, in processes of their own.")] = True,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot",
            help="Plot of FPS by objects and by crops to write: .png, .svg or .pdf; "
            'needs "re3[report]".',
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option(
            "--json", help="Write all figures to this file.", metavar="FILE", show_default=False
        ),
    ] = None,
) -> None:
    """Measure speed, memory and size here, and say what to choose.

    Frames are decoded beforehand. All trackers take turns on the same frames,
    round by round, so that their ratios hold on a busy machine as well. The
    search for lost objects is off. Tables go to stdout, progress to stderr.

    Examples:

        re3 bench

        re3 bench --threads 1,2 --engines onnx,torch --plot speed.png --json speed.json

        re3 bench --source clip.mp4 --box 120,80,60,140 --size own --peers csrt
    """
    console = stderr()
    try:
        if plot is not None:
            from re3.evaluation.plots_style import check_suffix, require

            check_suffix(plot)
            require("matplotlib")
        entries = [
            *our_entries(model.split(","), engines.split(","), _numbers("--threads", threads, 0)),
            *_peer_entries(peers, peer_files),
        ]
        footage = _footage(source, box, size)
        with TemporaryDirectory() as folder:
            plan = Plan(
                entries,
                _numbers("--objects", objects, 1),
                _sized(crop_sizes, Path(folder)),
                rounds,
                frames,
                memory,
            )
            with console.status("measuring") as status:
                study = run_study(plan, footage, lambda what: status.update(f"measuring {what}"))
        _tell(study)
        if plot is not None:
            from re3.benchmark.plots import speed_plot
            from re3.evaluation.plots_style import save

            console.print(f"{save(speed_plot(study), plot)}: plot", markup=False)
        if json_file is not None:
            write_whole(json_file, json.dumps(as_json(study), indent=1) + "\n")
            console.print(f"{json_file}: all figures", markup=False)
    except (ImportError, OSError, RuntimeError, ValueError) as error:
        raise failed(error) from error


def _tell(study: Study) -> None:
    """Print the machine, the tables and what they say."""
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)

    def say(text: str) -> None:
        console.print(text, markup=False)

    here, frame = study.environment, study.footage.frames[0]
    say(
        f"{here.cpu}, {here.cores} cores, {here.system}, load {here.load:.1f} before; {here.date}\n"
        + ", ".join(f"{name} {version}" for name, version in here.versions.items())
        + f"\nframes: {study.footage.name}, {frame.shape[1]} x {frame.shape[0]}, decoded before; "
        f"medians over {study.plan.rounds} rounds\n"
    )
    for table in tables(study):
        console.print(rich_table(table))
    for note in study.skipped:
        say(f"note: {note}")
    say("What to choose here:")
    for sentence in advice(study):
        say(f"- {sentence}")


def _footage(source: str | None, box: str | None, size: str) -> Footage:
    from re3.apps.track_options import parse_box

    wanted = None if size == "own" else _size(size)
    if source is None:
        if box is not None:
            raise ValueError(f"--box {box} without --source; give the frames that it is of as well")
        return made_footage(FRAMES_KEPT, wanted or SIZE)
    if box is None:
        raise ValueError(f"--source {source} without --box; say where the object is: --box X,Y,W,H")
    return read_footage(source, parse_box("--box", box), FRAMES_KEPT, wanted)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) >= 320 and int(height) >= 240):
        raise ValueError(
            f"--size {text!r} is not WIDTHxHEIGHT of 320x240 or more, such as 640x480, nor `own`"
        )
    return int(width), int(height)


def _numbers(option: str, text: str, least: int) -> list[int]:
    words = text.split(",")
    if not all(word.strip().isdecimal() and int(word) >= least for word in words):
        raise ValueError(
            f"{option} {text!r} is not whole numbers of {least} or more separated by commas, "
            "such as 1,2"
        )
    return [int(word) for word in words]


def _peer_entries(names: str | None, files: Path | None) -> Sequence[Entry]:
    if names == "none":
        return []
    if names is None:
        here = {info.name for info in available_trackers(files) if info.missing is None}
        chosen = [name for name in DEFAULT_PEERS if name in here]
    else:
        chosen = names.split(",")
    for name in chosen:
        find_tracker(name, files)  # says now what is wrong
    return [Entry(name, False, name, peer_files=files) for name in chosen]


def _sized(sizes: str | None, folder: Path) -> dict[int, Entry]:
    if sizes is None:
        return {}
    from re3.benchmark.crop_sizes import write_sized

    try:
        return write_sized(_numbers("--crop-sizes", sizes, 1), folder)
    except ImportError as error:
        raise ImportError(
            f'--crop-sizes writes networks, which needs torch ({error}); pip install "re3[train]"'
        ) from error
