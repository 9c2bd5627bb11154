"""`re3 track`: follow objects through a video, a folder of images, a camera or a stream."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.stopping import StopSignals
from re3.apps.track_options import Span, parse_objects, parse_range
from re3.apps.track_summary import Run, summarise
from re3.apps.tracking import Box, Tracked, track_video
from re3.engine import ENGINES
from re3.models import DEFAULT_MODEL
from re3.timed_tracker import TimedMultiTracker
from re3.video import FirstFrameKept, VideoSource, VideoWriter, open_results, open_source
from re3.video.grey_levels import Range
from re3.video.results_base import IMAGE_FIELD

BROKEN_SOURCE = 1
BROKEN_PIPE = 141
"""Exit code of a program whose reader went away, as shells have it."""


@dataclass(frozen=True)
class _Request:
    """What a run is asked for; the fields are the options of the command."""

    source: str
    objects: dict[str, Box]
    frames: Span
    out: Path | None
    results: str | None
    value_range: Range | None


def track(
    source: Annotated[
        str,
        typer.Argument(
            help="A video file; a folder or (quoted) glob of images; a camera index such as 0; "
            "an RTSP or HTTP stream.",
            metavar="SOURCE",
        ),
    ],
    boxes: Annotated[
        list[str] | None,
        typer.Option(
            "--box",
            "-b",
            help="The object in the first frame: left, top, width, height in pixels. Repeated, "
            "the objects are called object-1, object-2, and so on.",
            metavar="X,Y,W,H",
            show_default=False,
        ),
    ] = None,
    objects: Annotated[
        list[str] | None,
        typer.Option(
            "--object",
            help="A named object; repeat for several, tracked in one pass.",
            metavar="NAME=X,Y,W,H",
            show_default=False,
        ),
    ] = None,
    select: Annotated[
        bool,
        typer.Option("--select", help="Draw the boxes in the browser, on a page with that frame."),
    ] = False,
    start_frame: Annotated[
        int, typer.Option(help="Frame in which the boxes are; those before are skipped.", min=0)
    ] = 0,
    end_frame: Annotated[
        int | None,
        typer.Option(
            help="Last frame that is tracked, counted from 0 in the source as --start-frame is.",
            min=0,
            show_default=False,
        ),
    ] = None,
    max_frames: Annotated[
        int | None,
        typer.Option(help="Stop after so many frames.", min=1, show_default=False),
    ] = None,
    model: Annotated[
        str, typer.Option(help="A model's name (see `re3 models`) or file.")
    ] = DEFAULT_MODEL,
    engine: Annotated[
        str,
        typer.Option(help=f"One of {', '.join(ENGINES)}; auto is the fastest that the model has."),
    ] = "auto",
    mirror: Annotated[
        bool | None,
        typer.Option(
            "--mirror/--no-mirror",
            help="Look at each crop mirrored as well: more accurate, half as fast. Default: as "
            "the model is made; re3-base does.",
            show_default=False,
        ),
    ] = None,
    threads: Annotated[
        int,
        typer.Option(
            help="Threads of the network and of cutting crops; 0 takes one fewer than there are "
            "cores, 4 at most.",
            min=0,
        ),
    ] = 0,
    search: Annotated[
        bool,
        typer.Option(
            "--search/--no-search", help="Look for an object that is lost in a wider area."
        ),
    ] = True,
    value_range: Annotated[
        str | None,
        typer.Option(
            help="Lowest and highest value of 16-bit pixels, shown as black and white. Default: "
            "all 16 bits, or the range of the first image where that is less than half of them.",
            metavar="LOW,HIGH",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Annotated video to write, H.264 in MP4.",
            metavar="FILE.mp4",
            show_default=False,
        ),
    ] = None,
    results: Annotated[
        str | None,
        typer.Option(
            "--results",
            "-r",
            help="Boxes to write: .csv, .json, .jsonl, .txt (OTB: x,y,w,h a line), .mot.txt "
            "(MOTChallenge), .coco.json, or - for CSV on standard output.",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Track objects through a video, given their boxes in one frame.

    Examples:

        re3 track clip.mp4 --box 120,80,60,140 --out tracked.mp4 --results boxes.csv

        re3 track shots/ --object car=10,20,80,40 --object dog=200,90,40,50 --results -

        re3 track clip.mp4 --select --out tracked.mp4
    """
    console = stderr()
    try:
        request = _Request(
            source,
            parse_objects(boxes or [], objects or [], select),
            Span.of_options(start_frame, end_frame, max_frames),
            out,
            results,
            None if value_range is None else parse_range(value_range),
        )
        run = _run(
            console,
            request,
            lambda: TimedMultiTracker(model, engine, threads=threads, search=search, mirror=mirror),
        )
    except BrokenPipeError:
        # `re3 track ... --results - | head`: not an error of ours, nor anything to say.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(BROKEN_PIPE) from None
    except KeyboardInterrupt:  # before there is anything to finish
        raise typer.Exit(INTERRUPTED) from None
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    summarise(console, run, told=results is not None)
    if run.outcome.interrupted:
        raise typer.Exit(run.stopped.exit_code)
    if run.outcome.broken is not None or run.outcome.cut:
        raise typer.Exit(BROKEN_SOURCE)


def _run(console: Console, request: _Request, make_tracker: Callable[[], TimedMultiTracker]) -> Run:
    spec, out = request.source, request.out
    if out is not None and out.exists() and Path(spec).exists() and out.samefile(spec):
        raise ValueError(f"--out {out} is the source itself; give another name")
    rows = open_results(request.results, live=True) if request.results is not None else None
    tracker = make_tracker()
    with ExitStack() as stack:
        frames = stack.enter_context(
            open_source(spec, start_frame=request.frames.first, value_range=request.value_range)
        )
        for note in frames.notes:
            console.print(f"note: {note}", style="yellow", markup=False)
        objects = request.objects
        if not objects:
            frames = FirstFrameKept(frames)
            objects = _select(console, frames)
        video = _open_video(out, frames) if out is not None else None
        if rows is not None:
            rows.frame_size = frames.size
            rows.extra_fields = (IMAGE_FIELD,) if frames.has_names else ()
        # Entered before the writers, so that it is still there while they complete their files.
        stopped = stack.enter_context(StopSignals())
        for writer in (video, rows):
            if writer is not None:
                stack.enter_context(writer)
        bar = _progress_bar(console, frames, request.frames)
        # Elsewhere than on a terminal even a disabled bar of Rich 13 prints an empty line.
        with bar if console.is_terminal else nullcontext():
            outcome = track_video(
                frames,
                tracker,
                objects,
                video,
                rows,
                request.frames.count,
                lambda _, done: _show(bar, done),
                stopped,
            )
        stopped.finishing = True
    written = {}
    if out is not None and video is not None and video.frames_written:
        written[out] = video.frames_written
    if rows is not None:
        written.update((path, rows.frames_written) for path in rows.paths)
    return Run(frames.name, outcome, written, stopped)


def _open_video(out: Path, frames: VideoSource) -> VideoWriter:
    return VideoWriter(out, frames.fps, frames.size, pixel_aspect=frames.pixel_aspect, live=True)


def _select(console: Console, frames: FirstFrameKept) -> dict[str, Box]:
    """Boxes drawn on a page."""
    try:
        from re3.apps.server.running import open_browser
        from re3.apps.server.selecting import select_objects
    except ImportError as error:
        raise ImportError(
            f"--select needs FastAPI and Uvicorn ({error}): pip install 're3[serve]', "
            "or give the box with --box"
        ) from error

    def announce(url: str) -> None:
        console.print(f"draw boxes on {url} (Ctrl-C stops)", markup=False)
        open_browser(url)

    objects = select_objects(frames.first.image, frames.name, announce)
    for name, box in objects.items():
        numbers = ",".join(f"{value:.10g}" for value in box)
        console.print(f"--object {shlex.quote(f'{name}={numbers}')}", markup=False)
    return objects


def _progress_bar(console: Console, frames: VideoSource, span: Span) -> Progress:
    """One line on a terminal, nothing elsewhere."""
    total = None if frames.frame_count is None else frames.frame_count - span.first
    if span.count is not None:
        total = span.count if total is None else min(total, span.count)
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(show_speed=False),
        TextColumn("{task.fields[count]}"),
        TextColumn("{task.fields[fps]:.0f} FPS"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    )
    bar.add_task(f"tracking {frames.name}", total=total, fps=0.0, count="")
    return bar


def _show(bar: Progress, done: Tracked) -> None:
    """Bring the bar up to date; a total that was too low is dropped."""
    task = bar.tasks[0]
    if task.total is not None and done.frames > task.total:
        bar.update(task.id, total=None)
    of_total = "" if task.total is None else f" of {task.total:.0f}"
    count = f"{done.frames}{of_total} frames"
    bar.update(task.id, completed=done.frames, fps=done.fps, count=count)
