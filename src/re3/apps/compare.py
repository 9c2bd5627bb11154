"""`re3 compare`: paired differences between trackers, from the results of `re3 eval`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from re3.apps.console import failed
from re3.apps.evaluate_tables import PIPE_WIDTH, rich_table
from re3.evaluation.comparison import Comparison, TrackerFigures, read_results
from re3.evaluation.comparison import compare as compare_two
from re3.evaluation.report_data import without_nan
from re3.evaluation.report_tables import Cell, TextTable, number
from re3.evaluation.result_files import write_whole


def compare(
    results: Annotated[
        list[Path],
        typer.Argument(
            help="Folders that `re3 eval --out` has written, or their results.json.",
            metavar="RESULTS...",
            show_default=False,
        ),
    ],
    tracker: Annotated[
        list[str] | None,
        typer.Option(
            "--tracker",
            "-t",
            help="Only this tracker; repeat for several. Default: all in the results.",
            metavar="NAME",
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
    """Compare trackers with the first one: paired differences and their standard errors.

    Trackers are compared on the sequences that both have run, with the same
    protocol. The difference is the mean over clips, of a clip the mean over
    its starts, and its standard error is that over clips: a difference of less
    than two standard errors may be chance.

    Examples:

        re3 eval data/davis data/segtrack -p starts -t re3-lite --jobs 2 --out out/lite

        re3 eval data/davis data/segtrack -p starts -t runs/mine/re3-lite.safetensors --out out/mine

        re3 compare out/lite out/mine
    """
    try:
        first, *others = _chosen(read_results(results), tracker or [])
        comparisons = [compare_two(first, other) for other in others]
        if json_file is not None:
            document = [asdict(comparison) for comparison in comparisons]
            text = json.dumps(without_nan(document), indent=1, allow_nan=False)
            write_whole(json_file, f"{text}\n")
    except (OSError, ValueError) as error:
        raise failed(error) from error
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    for comparison in comparisons:
        console.print(rich_table(_figures_table(comparison)))
    console.print(rich_table(_clips_table(first, comparisons)))
    for comparison in comparisons:
        if comparison.left_out:
            console.print(
                f"note: {comparison.left_out} sequences were left out that only one of "
                f"{comparison.first} and {comparison.second} has",
                markup=False,
            )


def _chosen(found: list[TrackerFigures], names: list[str]) -> list[TrackerFigures]:
    """The trackers named, in the order of the names; two or more."""
    known = ", ".join(one.label for one in found)
    for name in names:
        if all(one.tracker != name for one in found):
            raise ValueError(f"no results of tracker {name!r}; there are some of {known}")
    chosen = [one for name in names for one in found if one.tracker == name] if names else found
    if len(chosen) < 2:
        raise ValueError(
            f"results of {known or 'no tracker'}; expected those of two trackers or more: give "
            "another folder as well"
        )
    return chosen


def _figures_table(comparison: Comparison) -> TextTable:
    header = ["figure", comparison.first, comparison.second, "difference", "\N{PLUS-MINUS SIGN}"]
    rows = [
        [
            Cell(figure.measure.heading),
            Cell(number(figure.first)),
            Cell(number(figure.second)),
            Cell(_signed(figure.difference.mean)),
            Cell(number(figure.difference.error)),
            Cell(str(figure.better)),
            Cell(str(figure.worse)),
        ]
        for figure in comparison.figures
    ]
    title = f"{comparison.second} against {comparison.first}: {len(comparison.clips)} clips"
    return TextTable(title, [*header, "clips better", "clips worse"], rows)


def _clips_table(first: TrackerFigures, comparisons: list[Comparison]) -> TextTable:
    """A row a clip: the main figure of the first tracker, and the differences to it."""
    names = dict.fromkeys(clip.clip for each in comparisons for clip in each.clips)
    of_clips = [{clip.clip: clip for clip in each.clips} for each in comparisons]
    rows = []
    for name in names:
        there = [clips.get(name) for clips in of_clips]
        value = next(clip.first for clip in there if clip is not None)
        differences = [
            Cell("-" if clip is None else _signed(clip.second - clip.first)) for clip in there
        ]
        rows.append([Cell(name), Cell(number(value)), *differences])
    heading = comparisons[0].figures[0].measure.heading
    title = f"{heading} by clip, and differences to {first.label}"
    return TextTable(title, ["clip", first.label, *(each.second for each in comparisons)], rows)


def _signed(value: float) -> str:
    return f"{value:+.3f}"
