"""`re3 track`: follow objects through a video, a folder of images, a camera or a stream."""

from __future__ import annotations

import os
import shlex
import sys
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.stopping import StopSignals
from re3.apps.tracking import Box, Tracked, track_video
from re3.engine import ENGINES
from re3.models import DEFAULT_MODEL
from re3.timed_tracker import TimedMultiTracker
from re3.video import FirstFrameKept, VideoSource, VideoWriter, open_results, open_source

BROKEN_SOURCE = 1
BROKEN_PIPE = 141
"""Exit code of a program whose reader went away, as shells have it."""


@dataclass(frozen=True)
class _Run:
    """What there is to tell of a run.

    Attributes:
        source: what was tracked, by name.
        outcome: of the tracking.
        written: files and the number of frames in each.
        stopped: what asked to stop, if anything did.
    """

    source: str
    outcome: Tracked
    written: dict[Path, int]
    stopped: StopSignals


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
        run = _run(
            console,
            source,
            _parse_objects(boxes or [], objects or [], select),
            start_frame,
            max_frames,
            model,
            engine,
            mirror,
            out,
            results,
        )
    except BrokenPipeError:
        # `re3 track ... --results - | head`: not an error of ours, nor anything to say.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(BROKEN_PIPE) from None
    except KeyboardInterrupt:  # before there is anything to finish
        raise typer.Exit(INTERRUPTED) from None
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    _summarise(console, run, told=results is not None)
    if run.outcome.interrupted:
        raise typer.Exit(run.stopped.exit_code)
    if run.outcome.broken is not None:
        raise typer.Exit(BROKEN_SOURCE)


def _run(
    console: Console,
    spec: str,
    objects: dict[str, Box],
    start_frame: int,
    max_frames: int | None,
    model: str,
    engine: str,
    mirror: bool | None,
    out: Path | None,
    results: str | None,
) -> _Run:
    if out is not None and out.exists() and Path(spec).exists() and out.samefile(spec):
        raise ValueError(f"--out {out} is the source itself; give another name")
    rows = open_results(results) if results is not None else None
    tracker = TimedMultiTracker(model, engine, mirror=mirror)
    with ExitStack() as stack:
        frames = stack.enter_context(open_source(spec, start_frame=start_frame))
        if not objects:
            frames = FirstFrameKept(frames)
            objects = _select(console, frames)
        video = VideoWriter(out, frames.fps, frames.size) if out is not None else None
        if rows is not None:
            rows.frame_size = frames.size
        # Entered before the writers, so that it is still there while they complete their files.
        stopped = stack.enter_context(StopSignals())
        for writer in (video, rows):
            if writer is not None:
                stack.enter_context(writer)
        bar = _progress_bar(console, frames, start_frame, max_frames)
        # Elsewhere than on a terminal even a disabled bar of Rich 13 prints an empty line.
        with bar if console.is_terminal else nullcontext():
            outcome = track_video(
                frames,
                tracker,
                objects,
                video,
                rows,
                max_frames,
                lambda _, done: bar.update(bar.task_ids[0], completed=done.frames, fps=done.fps),
                stopped,
            )
        stopped.finishing = True
    written = {}
    if out is not None and video is not None and video.frames_written:
        written[out] = video.frames_written
    if rows is not None:
        written.update((path, rows.frames_written) for path in rows.paths)
    return _Run(frames.name, outcome, written, stopped)


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


def _progress_bar(
    console: Console, frames: VideoSource, start_frame: int, max_frames: int | None
) -> Progress:
    """One line on a terminal, nothing elsewhere."""
    total = None if frames.frame_count is None else frames.frame_count - start_frame
    if max_frames is not None:
        total = max_frames if total is None else min(total, max_frames)
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(show_speed=False),
        TextColumn("{task.completed} of {task.total} frames" if total else "{task.completed}"),
        TextColumn("{task.fields[fps]:.0f} FPS"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    )
    bar.add_task(f"tracking {frames.name}", total=total, fps=0.0)
    return bar


def _summarise(console: Console, run: _Run, *, told: bool) -> None:
    """Say what came of it; `told` if the boxes went anywhere."""
    outcome = run.outcome

    def say(text: str, style: str | None = None) -> None:
        console.print(text, style=style, markup=False)

    if outcome.interrupted:
        say(f"stopped by {run.stopped.name} after {outcome.frames} frames", "yellow")
    if outcome.broken is not None:
        say(f"stopped early: {outcome.broken}", "yellow")
    # Files cut to length announce a few frames more than they give.
    if outcome.missing > max(2, 0.02 * outcome.frames):
        say(
            f"note: {run.source} announces {outcome.missing} frames more than it gave; "
            "is it complete?",
            "yellow",
        )
    for path, count in run.written.items():
        say(f"{path}: {count} frames")
    for result in outcome.last.values():
        x, y, w, h = result.box_xywh
        say(f"last box of {result.label}: {x:.1f},{y:.1f},{w:.1f},{h:.1f} ({result.status})")
    counts = ", ".join(f"{status} {count}" for status, count in outcome.statuses.items())
    say(f"{outcome.frames} frames; boxes by status: {counts}")
    if outcome.updates:
        crops, network = (
            1000 * seconds / outcome.updates
            for seconds in (outcome.crop_seconds, outcome.network_seconds)
        )
        whole = 1000 / outcome.fps
        say(
            f"tracking: {outcome.fps:.0f} FPS ({whole:.1f} ms a frame without decoding and "
            f"encoding: crops {crops:.1f}, network {network:.1f}, rest "
            f"{whole - crops - network:.1f})"
        )
    if not run.written and not told:
        say("nothing was written; --out FILE.mp4 or --results FILE.csv keep the boxes")


def _parse_objects(boxes: list[str], named: list[str], select: bool) -> dict[str, Box]:
    """Name -> box, none to `select` them later; raises ValueError that says what was given."""
    names = ["object"] if len(boxes) == 1 else [f"object-{i + 1}" for i in range(len(boxes))]
    objects = {name: parse_box("--box", box) for name, box in zip(names, boxes, strict=True)}
    for text in named:
        name, equals, numbers = text.rpartition("=")
        if not equals or not name.strip():
            raise ValueError(f"--object {text!r} is not NAME=X,Y,W,H, such as car=10,20,80,40")
        if name.strip() in objects:
            raise ValueError(f"two objects are called {name.strip()!r}; give each its own name")
        objects[name.strip()] = parse_box("--object", numbers)
    if not objects and not select:
        raise ValueError(
            "no object to track; give its box in the first frame: --box X,Y,W,H "
            "(left, top, width, height in pixels), or draw it: --select"
        )
    if objects and select:
        raise ValueError("--select draws the boxes; leave out --box and --object")
    return objects


def parse_box(option: str, text: str) -> Box:
    """Four numbers separated by commas; raises ValueError that names the option."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(
            f"{option} {text!r} is not X,Y,W,H: four numbers, left, top, width and height in "
            "pixels, separated by commas, such as 120,80,60,140"
        ) from error
    return x, y, w, h
