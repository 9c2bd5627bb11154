"""`re3 track`: follow objects through a video, a folder of images, a camera or a stream."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.engine import ENGINES
from re3.models import DEFAULT_MODEL
from re3.result import Result
from re3.tracker import MultiTracker
from re3.video import (
    Frame,
    ResultsWriter,
    SourceError,
    VideoSource,
    VideoWriter,
    draw_results,
    open_results,
    open_source,
)

Box = tuple[float, float, float, float]


@dataclass
class Tracked:
    """What came of a run.

    Attributes:
        frames: in which objects were followed, the first included.
        seconds: spent in the tracker: crops, network and state, without decoding and encoding.
        updates: calls of `update` in that time.
        statuses: number of results by status.
        last: the latest result of each object.
        interrupted: whether Ctrl-C ended it.
        broken: why the source ended early, or None.
    """

    frames: int = 0
    seconds: float = 0.0
    updates: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    last: dict[int, Result] = field(default_factory=dict)
    interrupted: bool = False
    broken: str | None = None

    @property
    def fps(self) -> float:
        """Frames tracked a second; 0 before the first update."""
        return self.updates / self.seconds if self.seconds else 0.0


def track_video(
    source: VideoSource,
    tracker: MultiTracker,
    objects: dict[str, Box],
    video: VideoWriter | None = None,
    results: ResultsWriter | None = None,
    max_frames: int | None = None,
    on_frame: Callable[[Frame, Tracked], None] | None = None,
) -> Tracked:
    """Track objects from the source's first frame on, writing as it goes.

    Ctrl-C and a source that breaks end the run; what was tracked until then stays written.

    Args:
        source: opened at the frame in which the boxes are.
        tracker: without objects.
        objects: name -> x, y, width, height in pixels of the first frame.
        video, results: open writers, or None.
        max_frames: stop after so many frames.
        on_frame: called after each frame.

    Raises:
        ValueError: a box that the tracker refuses.
        SourceError: the source breaks before its first frame.
    """
    outcome = Tracked()
    try:
        for frame in source:
            started = time.perf_counter()
            if outcome.frames == 0:
                for name, box in objects.items():
                    tracker.add(frame.image, box, name)
                outcome.last = tracker.results
            else:
                outcome.last = tracker.update(frame.image)
                outcome.seconds += time.perf_counter() - started
                outcome.updates += 1
            outcome.statuses.update(str(r.status) for r in outcome.last.values())
            if results is not None:
                results.write(frame.index, frame.timestamp, outcome.last.values())
            if video is not None:
                video.write(draw_results(frame.image, outcome.last.values()))
            outcome.frames += 1
            if on_frame is not None:
                on_frame(frame, outcome)
            if outcome.frames == max_frames:
                break
    except KeyboardInterrupt:
        outcome.interrupted = True
    except SourceError as error:
        if outcome.frames == 0:
            raise
        outcome.broken = str(error)
    return outcome


def track(
    source: Annotated[
        str,
        typer.Argument(
            help="A video file; a folder or (quoted) glob of images; a camera index such as 0; "
            "an RTSP or HTTP stream.",
            metavar="SOURCE",
        ),
    ],
    box: Annotated[
        str | None,
        typer.Option(
            "--box",
            "-b",
            help="The object in the first frame: left, top, width, height in pixels.",
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
    engine: Annotated[str, typer.Option(help=f"One of {', '.join(ENGINES)}.")] = "auto",
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
            help="Boxes to write: .csv, .json, .jsonl, .txt (OTB: x,y,w,h a line), or - for CSV "
            "on standard output.",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Track objects through a video, given their boxes in one frame.

    Examples:

        re3 track clip.mp4 --box 120,80,60,140 --out tracked.mp4 --results boxes.csv

        re3 track shots/ --object car=10,20,80,40 --object dog=200,90,40,50 --results -
    """
    console = stderr()
    try:
        outcome, written = _run(
            console,
            source,
            _parse_objects(box, objects or []),
            start_frame,
            max_frames,
            model,
            engine,
            out,
            results,
        )
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    _summarise(console, outcome, written)
    if outcome.interrupted:
        raise typer.Exit(INTERRUPTED)
    if outcome.broken is not None:
        raise typer.Exit(1)


def _run(
    console: Console,
    spec: str,
    objects: dict[str, Box],
    start_frame: int,
    max_frames: int | None,
    model: str,
    engine: str,
    out: Path | None,
    results: str | None,
) -> tuple[Tracked, list[Path]]:
    if out is not None and out.exists() and Path(spec).exists() and out.samefile(spec):
        raise ValueError(f"--out {out} is the source itself; give another name")
    rows = open_results(results) if results is not None else None
    tracker = MultiTracker(model, engine)
    with ExitStack() as stack:
        frames = stack.enter_context(open_source(spec, start_frame=start_frame))
        video = VideoWriter(out, frames.fps, frames.size) if out is not None else None
        for writer in (video, rows):
            if writer is not None:
                stack.enter_context(writer)
        total = None if frames.frame_count is None else frames.frame_count - start_frame
        if max_frames is not None:
            total = max_frames if total is None else min(total, max_frames)
        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(show_speed=False),
            TextColumn("{task.completed} of {task.total} frames" if total else "{task.completed}"),
            TextColumn("{task.fields[fps]:.0f} FPS"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        task = bar.add_task(f"tracking {frames.name}", total=total, fps=0.0)
        with bar:
            outcome = track_video(
                frames,
                tracker,
                objects,
                video,
                rows,
                max_frames,
                lambda _, done: bar.update(task, completed=done.frames, fps=done.fps),
            )
    written = [out] if out is not None and outcome.frames else []
    return outcome, written + (rows.paths if rows is not None else [])


def _summarise(console: Console, outcome: Tracked, written: list[Path]) -> None:
    def say(text: str, style: str | None = None) -> None:
        console.print(text, style=style, markup=False)

    if outcome.interrupted:
        say(f"stopped by Ctrl-C after {outcome.frames} frames", "yellow")
    if outcome.broken is not None:
        say(f"stopped early: {outcome.broken}", "yellow")
    for path in written:
        say(f"{path}: {outcome.frames} frames")
    for result in outcome.last.values():
        x, y, w, h = result.box_xywh
        say(f"last box of {result.label}: {x:.1f},{y:.1f},{w:.1f},{h:.1f} ({result.status})")
    counts = ", ".join(f"{status} {count}" for status, count in outcome.statuses.items())
    say(f"{outcome.frames} frames; boxes by status: {counts}")
    if outcome.updates:
        say(
            f"tracking: {outcome.fps:.0f} FPS ({1000 / outcome.fps:.1f} ms a frame: crops, network "
            "and state, without decoding and encoding)"
        )
    if not written:
        say("nothing was written; --out FILE.mp4 or --results FILE.csv keep the boxes")


def _parse_objects(box: str | None, named: list[str]) -> dict[str, Box]:
    """Name -> box; raises ValueError that says what was given."""
    objects = {} if box is None else {"object": _parse_box("--box", box)}
    for text in named:
        name, equals, numbers = text.rpartition("=")
        if not equals or not name.strip():
            raise ValueError(f"--object {text!r} is not NAME=X,Y,W,H, such as car=10,20,80,40")
        if name.strip() in objects:
            raise ValueError(f"two objects are called {name.strip()!r}; give each its own name")
        objects[name.strip()] = _parse_box("--object", numbers)
    if not objects:
        raise ValueError(
            "no object to track; give its box in the first frame: --box X,Y,W,H "
            "(left, top, width, height in pixels)"
        )
    return objects


def _parse_box(option: str, text: str) -> Box:
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(
            f"{option} {text!r} is not X,Y,W,H: four numbers, left, top, width and height in "
            "pixels, separated by commas, such as 120,80,60,140"
        ) from error
    return x, y, w, h
