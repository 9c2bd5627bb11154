"""`re3 data stats` and `re3 data show`: what training really samples, in figures and pictures."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.sequences import FORMAT_HELP
from re3.apps.training_data import DEFAULT_CACHE_GB, CacheOption, mix_or_folders

if TYPE_CHECKING:
    from re3.data.survey import SourceFacts, Survey

PIPE_WIDTH = 160
PICTURES = (".png", ".jpg", ".jpeg", ".webp")
LITE_CONTEXT = 3.0
"""Side of re3-lite's search crop in units of the box's."""

DataArgument = Annotated[
    list[Path],
    typer.Argument(
        help="A mix (.yaml), as for `re3 train --mix`, or folders, as for `re3 train --data`.",
        metavar="MIX.yaml|DIR...",
    ),
]
FormatOption = Annotated[
    str | None,
    typer.Option("--format", "-f", help=FORMAT_HELP, metavar="NAME", show_default=False),
]
ExcludeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude",
        help="Of folders: leave out the dataset of this name; repeat for several.",
        metavar="NAME",
        show_default=False,
    ),
]
SeedOption = Annotated[int, typer.Option(help="Another seed, other clips.", min=0)]


def stats(
    data: DataArgument,
    clips: Annotated[int, typer.Option(help="Clips to draw.", min=1)] = 400,
    frames: Annotated[
        int, typer.Option(help="Frames of a clip; training has 3 to 33 of them.", min=2)
    ] = 33,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help='Plot to write: .png, .pdf or .svg. Needs the extra "report".',
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    format_name: FormatOption = None,
    exclude: ExcludeOption = None,
    seed: SeedOption = 0,
    cache_gb: CacheOption = DEFAULT_CACHE_GB,
) -> None:
    """Draw clips as training would, and print and plot what they are like.

    Of every source: its share, sizes in pixels (of frames as training sees
    them, 640 pixels at most), motion and change of the size from one frame to
    the next, and how often the object is occluded or absent. No video is
    decoded for it. Three figures are the 10th percentile, the median and the
    90th.

    Example:

        re3 data stats mix.yaml --clips 1000 --out stats.png
    """
    from re3.data.survey import survey

    try:
        if out is not None:
            from re3.evaluation.plots_style import check_suffix, require, save

            # Before anything is drawn.
            check_suffix(out)
            require("matplotlib")
        sampler = mix_or_folders(data, set(exclude or []), format_name, cache_gb)
        with _bar() as bar:
            task = bar.add_task("clips", total=clips)
            found = survey(
                sampler, clips, frames, seed, lambda done: bar.update(task, completed=done)
            )
        _print(found, frames)
        if out is not None:
            from re3.apps.data_stats_plot import stats_plot

            save(stats_plot(found), out)
            stderr().print(f"{out}: plot of {clips} clips", markup=False)
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        stderr().print("interrupted", markup=False)
        raise typer.Exit(INTERRUPTED) from None


def show(
    data: DataArgument,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help=f"Picture to write: {', '.join(PICTURES)}.", metavar="FILE"
        ),
    ],
    clips: Annotated[int, typer.Option(help="Clips to draw, one a row.", min=1)] = 12,
    frames: Annotated[int, typer.Option(help="Frames of a clip.", min=2)] = 8,
    size: Annotated[int, typer.Option(help="Side of a crop in pixels.", min=32)] = 128,
    context: Annotated[
        float,
        typer.Option(help="Side of a crop in units of the box's; re3-lite's by default.", min=1.0),
    ] = LITE_CONTEXT,
    format_name: FormatOption = None,
    exclude: ExcludeOption = None,
    seed: SeedOption = 0,
    cache_gb: CacheOption = DEFAULT_CACHE_GB,
) -> None:
    """Draw clips as training would, and show their crops with the target, to see mistakes.

    A row is a clip: crops of consecutive frames, each cut at the true box of
    the frame before, with the true box of its own. Green: in sight; orange:
    half hidden or more; a red border: absent, or outside the crop.

    Example:

        re3 data show mix.yaml --clips 20 --out sheet.png
    """
    import cv2

    from re3.data.contact_sheet import contact_sheet

    try:
        if out.suffix.lower() not in PICTURES:
            raise ValueError(f"{out} does not end in {', '.join(PICTURES)}; give one of these")
        sampler = mix_or_folders(data, set(exclude or []), format_name, cache_gb)
        rows = []
        with _bar() as bar:
            for child in bar.track(np.random.SeedSequence(seed).spawn(clips), description="clips"):
                clip = sampler.sample(frames, np.random.default_rng(child))
                # Row by row: the frames of all clips together may not fit into memory.
                rows.append(contact_sheet([clip], context, size))
        _, encoded = cv2.imencode(out.suffix.lower(), np.concatenate(rows))
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(encoded.tobytes())
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    except KeyboardInterrupt:
        stderr().print("interrupted", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    stderr().print(f"{out}: {clips} clips of {frames} frames", markup=False)


def _bar() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


def _print(found: Survey, frames: int) -> None:
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("source", overflow="fold")
    for heading in (
        "kind",
        "clips",
        "by weight",
        "drawn",
        "size, px",
        "motion",
        "size changes",
        "occluded",
        "absent",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for source in found.sources():
        table.add_row(*_row(source))
    console.print(table)
    console.print(
        f"{len(found.clips)} clips of {frames} frames. Motion is from frame to frame in units of "
        "the object's size. Occluded: half hidden or more, where that is known.",
        markup=False,
    )


def _row(source: SourceFacts) -> list[str]:
    return [
        escape(source.name),
        source.kind,
        str(source.clips),
        f"{source.declared:.1%}",
        f"{source.drawn:.1%}",
        _three(source.size, ".0f"),
        _three(source.motion, ".3f"),
        _three(source.growth, ".1%"),
        "-" if math.isnan(source.occluded) else f"{source.occluded:.1%}",
        "-" if math.isnan(source.absent) else f"{source.absent:.1%}",
    ]


def _three(values: tuple[float, float, float], form: str) -> str:
    if math.isnan(values[1]):
        return "-"
    return " ".join(format(value, form) for value in values)
