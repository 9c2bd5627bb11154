"""`re3 data label`: training tracks from video without annotation."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.options import PeersOption, SequencesOption
from re3.apps.sequences import choose_sequences, read_sequences
from re3.labelling.config import LabelConfig

if TYPE_CHECKING:
    from re3.labelling.agreement import Pair

PIPE_WIDTH = 160
UNUSABLE = 1
"""Exit code after a video that could not be read."""
DEFAULTS = LabelConfig()


def label(
    videos: Annotated[
        list[Path],
        typer.Argument(
            help="Video files, and folders that are searched with all below.",
            metavar="VIDEO|DIR...",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the tracks: a .mp4 and a .txt each.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    teacher: Annotated[
        str, typer.Option(help="Tracker that runs in both directions; see `re3 eval --list`.")
    ] = "fear-xs",
    second: Annotated[str, typer.Option(help="Tracker that must agree with it.")] = "re3-lite",
    threshold: Annotated[
        float,
        typer.Option(help="Least overlap (IoU) of any two boxes of a frame.", metavar="IOU"),
    ] = DEFAULTS.threshold,
    shortest: Annotated[int, typer.Option(help="Frames of a track at least.")] = DEFAULTS.shortest,
    longest: Annotated[int, typer.Option(help="Frames of a track at most.")] = DEFAULTS.longest,
    fps: Annotated[
        float, typer.Option(help="Frames a second; a video with more is thinned out.")
    ] = DEFAULTS.fps,
    side: Annotated[
        int, typer.Option(help="Longer side of the frames in pixels at most.")
    ] = DEFAULTS.side,
    objects: Annotated[
        int, typer.Option(help="Objects in --longest frames at most.")
    ] = DEFAULTS.objects,
    given: Annotated[
        bool,
        typer.Option(
            "--given",
            help="Start from the boxes in the .txt or .jsonl file beside each video, and search "
            "for no others.",
        ),
    ] = False,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Write nothing: measure on annotated clips how accurate the kept boxes are.",
        ),
    ] = False,
    sequences: SequencesOption = None,
    peers: PeersOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON instead of the table.")
    ] = False,
) -> None:
    """Label video without annotation by two trackers that agree.

    Objects are searched for where something moves, or stands out if nothing
    does. Teacher and second tracker follow each from there to both ends, the
    teacher also back from the last frame. Kept are the stretches in which all
    three boxes overlap; the box written is their mean, interpolated over up
    to three frames without agreement. A run that was stopped goes on with the same
    command. With --check, videos are annotated clips, and the start is the
    annotated box in the middle of --longest frames.

    Example:

        re3 data label footage --teacher fear-xs --out tracks
    """
    from re3.evaluation.peers import find_tracker
    from re3.labelling.agreement import Pair

    try:
        config = LabelConfig(
            threshold=threshold,
            shortest=shortest,
            longest=longest,
            fps=fps,
            side=side,
            objects=objects,
        )
        if check == (out is not None):
            raise ValueError(
                "--check writes no tracks; leave out --out"
                if check
                else "no folder for the tracks; give one with --out"
            )
        if not check and sequences is not None:
            raise ValueError("--sequences chooses annotated clips; give it with --check only")
        factories = [find_tracker(name, peers).factory for name in (teacher, second)]
        if None in factories:
            raise ValueError(f"{teacher} and {second} must both run; one has published boxes only")
        first, other = (factory() for factory in factories if factory is not None)
        pair = Pair(first, other)
        if check:
            _check(videos, sequences, pair, config, as_json)
            return
        assert out is not None
        broken = _label(videos, out, (teacher, second), pair, config, given, as_json)
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        stderr().print("interrupted; the same command goes on", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    if broken:
        raise typer.Exit(UNUSABLE)


def _label(
    paths: list[Path],
    out: Path,
    names: tuple[str, str],
    pair: Pair,
    config: LabelConfig,
    given: bool,
    as_json: bool,
) -> int:
    """Label videos and print a table; returns how many could not be read."""
    from re3.labelling.tracks import TrackFolder, find_videos, given_boxes, settings_of
    from re3.labelling.videos import label_video
    from re3.video import SourceError

    videos = find_videos(paths, out)
    folder = TrackFolder(out, settings_of(config, *names, given))
    boxes = {name: given_boxes(video) for name, video in videos.items()} if given else {}
    rows: list[dict[str, object]] = []
    with _bar() as bar:
        for name, video in bar.track(videos.items(), description="videos"):
            earlier = folder.tracks_of(name)
            if earlier is not None:
                rows.append({"video": name, "tracks": earlier, "note": "labelled before"})
                continue
            try:
                tracks, rate = label_video(video, pair, config, boxes.get(name))
            except SourceError as error:
                rows.append({"video": name, "tracks": 0, "note": "", "error": str(error)})
                continue
            folder.write(name, tracks, rate)
            frames = sum(len(track.boxes_xywh) for track in tracks)
            note = f"{frames} frames" if tracks else ""
            rows.append({"video": name, "tracks": len(tracks), "note": note})
    broken = sum("error" in row for row in rows)
    if as_json:
        typer.echo(json.dumps({"out": str(out), "videos": rows}, indent=2, ensure_ascii=False))
        return broken
    table = _table("video", "tracks", "")
    for row in rows:
        note = f"! {row['error']}" if "error" in row else str(row["note"])
        table.add_row(escape(str(row["video"])), str(row["tracks"]), escape(note))
    _console().print(table)
    total = sum(folder.tracks_of(name) or 0 for name in videos)
    _console().print(
        f"{out}: {total} tracks of {len(videos)} videos; {broken} could not be read", markup=False
    )
    return broken


def _check(
    folders: list[Path], names: str | None, pair: Pair, config: LabelConfig, as_json: bool
) -> None:
    from re3.labelling.check import THRESHOLDS, accuracy, follow_annotated

    chosen = choose_sequences(read_sequences(folders), names)
    with _bar() as bar:
        task = bar.add_task("clips", total=len(chosen))
        checked = follow_annotated(
            chosen, pair, config, lambda done: bar.update(task, completed=done)
        )
    if not checked:
        raise ValueError(
            f"none of the {len(chosen)} clips has {config.shortest} frames without a cut and a "
            "box in them; give others, or a smaller --shortest"
        )
    measured = [accuracy(checked, t, config) for t in sorted({*THRESHOLDS, config.threshold})]
    if as_json:
        document = {"clips": len(checked), "thresholds": [_finite(asdict(m)) for m in measured]}
        typer.echo(json.dumps(document, indent=2))
        return
    table = _table("threshold", "tracks", "frames kept", "IoU >= .5", "IoU >= .7", "mean IoU")
    for row in measured:
        shares = (row.kept, row.above_half, row.above_seven_tenths)
        table.add_row(
            f"{row.threshold:g}" if row.threshold else "none",
            str(row.tracks),
            *map(_share, shares),
            "-" if math.isnan(row.mean_overlap) else f"{row.mean_overlap:.3f}",
        )
    _console().print(table)
    _console().print(
        f"{len(checked)} clips, at most {config.longest} frames of each. Threshold: least overlap "
        "of any two of the three boxes. IoU: with the annotation, over the kept frames without the "
        "start; a kept frame in which the object is absent counts as 0.",
        markup=False,
    )


def _finite(measured: dict[str, float]) -> dict[str, float | None]:
    return {key: None if math.isnan(value) else value for key, value in measured.items()}


def _share(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1%}"


def _bar() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)


def _table(first: str, *others: str) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column(first, overflow="fold")
    for heading in others:
        table.add_column(heading, justify="right" if heading else "left", overflow="fold")
    return table
