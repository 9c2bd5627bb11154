"""The figures of a run as tables of text, for a terminal, a Markdown file and a page alike."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from re3.evaluation.occlusion import occlusion_table
from re3.evaluation.one_pass import Latency
from re3.evaluation.protocol import Measure, RepeatedFigures
from re3.evaluation.summary import Run, TrackerRow
from re3.evaluation.time_parts import TimeParts

Mark = Literal["", "tracker", "best", "second"]
Best = Literal["high", "low"]


@dataclass(frozen=True)
class Cell:
    """A cell of a table: its text, and whether it names a tracker or is the (second) best."""

    text: str
    mark: Mark = ""


@dataclass(frozen=True)
class TextTable:
    """A table: names in the first column, figures in the others; one row or more."""

    title: str
    header: list[str]
    rows: list[list[Cell]]


def summary_table(run: Run, dataset: str) -> TextTable:
    """A row a tracker: the protocol's figures, speed where it means something, any failures."""
    rows = _rows_of(run, dataset)
    count = max(row.sequences for row in rows)
    columns = [_column(measure, rows) for measure in run.protocol.measures]
    if run.timing_is_comparable:
        columns.append(("FPS", _marked([(row.fps, speed(row.fps)) for row in rows], "high")))
        columns.append(_milliseconds("p95 ms", [row.latency.p95 for row in rows]))
    if any(row.failed for row in rows):
        columns.append(("failed", [Cell(str(row.failed) if row.failed else "") for row in rows]))
    name = dataset or "sequences"
    title = f"{name}: {count} sequence{'s' if count > 1 else ''}, {run.protocol.name}"
    return _by_tracker(title, rows, columns)


def speed_tables(run: Run, dataset: str) -> list[TextTable]:
    """A row a tracker: percentiles of the time of an update, and the time to read a frame.

    None where trackers ran side by side: their times are not those of a tracker by itself.
    """
    if not run.timing_is_comparable:
        return []
    rows = _rows_of(run, dataset)
    columns = [
        _milliseconds("p50 ms", [row.latency.p50 for row in rows]),
        _milliseconds("p95 ms", [row.latency.p95 for row in rows]),
        _milliseconds("p99 ms", [row.latency.p99 for row in rows]),
        ("reading ms", [Cell(number(row.decode_seconds * 1000, 1)) for row in rows]),
    ]
    title = "Time of an update and, apart from it, of reading a frame"
    return [_by_tracker(title, rows, columns)]


def time_tables(run: Run, dataset: str) -> list[TextTable]:
    """A row a tracker: where the time of a frame goes, median and 95 % of each part.

    None where trackers ran side by side, or nothing was measured. Crops and network are columns
    where a tracker tells of them.
    """
    rows = [row for row in _rows_of(run, dataset) if not math.isnan(row.parts.update.p50)]
    if not run.timing_is_comparable or not rows:
        return []
    columns: list[tuple[str, Callable[[TimeParts], Latency]]] = [("update", lambda p: p.update)]
    if any(row.parts.split for row in rows):
        columns = [
            ("crops", lambda p: p.crop),
            ("network", lambda p: p.network),
            ("rest", lambda p: p.rest),
            *columns,
        ]
    if any(not math.isnan(row.parts.decode.p50) for row in rows):
        columns = [("reading", lambda p: p.decode), *columns, ("whole", lambda p: p.whole)]
    cells = [
        (heading, [Cell(_median_and_95(part(row.parts))) for row in rows])
        for heading, part in columns
    ]
    return [_by_tracker("Where the time of a frame goes, ms: median / 95 %", rows, cells)]


def sequence_tables(run: Run, dataset: str) -> list[TextTable]:
    """For each figure that the protocol has by sequence: a row a sequence, a column a tracker."""
    rows = [row for row in run.sequence_rows if row.dataset == dataset]
    tables = []
    for measure in map(run.protocol.measure, run.protocol.by_sequence):
        body = []
        for row in rows:
            values = []
            for tracker in run.trackers:
                value = row.figures.get(tracker, {}).get(measure.name, math.nan)
                mark = " x" if tracker in row.failed else ""
                values.append((value, _figure(measure, value) + mark))
            cells = _marked(values, measure.best)
            body.append([Cell(row.sequence), Cell(str(row.frames)), *cells])
        header = ["sequence", "frames", *run.trackers]
        tables.append(TextTable(f"{measure.heading} by sequence", header, body))
    return tables


def occlusion_tables(run: Run) -> list[TextTable]:
    """All frames beside occluded ones, a row a dataset and tracker; none without marks."""
    rows = occlusion_table(run.results) if run.protocol.one_pass else []
    if not rows:
        return []
    header = ["dataset", "tracker", "AUC", "occluded", "loss", "P@20", "occluded", "frames"]
    body = [
        [
            Cell(row.dataset),
            Cell(row.tracker, "tracker"),
            Cell(number(row.everywhere.auc)),
            Cell(number(row.occluded.auc)),
            Cell("-" if math.isnan(row.relative_loss) else f"{row.relative_loss:.1%}"),
            Cell(number(row.everywhere.precision)),
            Cell(number(row.occluded.precision)),
            Cell(f"{row.occluded.frames} of {row.everywhere.frames}"),
        ]
        for row in rows
    ]
    return [TextTable("All frames and occluded frames, pooled over sequences", header, body)]


def number(value: float, digits: int = 3) -> str:
    """A figure with so many decimals, or a dash."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def speed(fps: float) -> str:
    """Frames a second, or a dash."""
    return number(fps, 1 if fps < 100 else 0)


def _rows_of(run: Run, dataset: str) -> list[TrackerRow]:
    return [row for row in run.tracker_rows if row.dataset == dataset]


def _by_tracker(
    title: str, rows: list[TrackerRow], columns: list[tuple[str, list[Cell]]]
) -> TextTable:
    cells = zip(*(column for _, column in columns), strict=True)
    body = [
        [Cell(row.tracker, "tracker"), *figures] for row, figures in zip(rows, cells, strict=True)
    ]
    return TextTable(title, ["tracker", *(heading for heading, _ in columns)], body)


def _column(measure: Measure, rows: list[TrackerRow]) -> tuple[str, list[Cell]]:
    cells = [(row.figures.mean[measure.name], _with_spread(measure, row.figures)) for row in rows]
    return measure.heading, _marked(cells, measure.best)


def _milliseconds(heading: str, seconds: list[float]) -> tuple[str, list[Cell]]:
    cells = [(value, number(value * 1000, 1)) for value in seconds]
    return heading, _marked(cells, "low")


def _median_and_95(latency: Latency) -> str:
    # A crop takes a few tenths of a millisecond, a slow tracker a second.
    texts = [
        number(ms, 2 if ms < 1 else 1 if ms < 100 else 0)
        for ms in (1000 * latency.p50, 1000 * latency.p95)
    ]
    return "-" if math.isnan(latency.p50) else " / ".join(texts)


def _figure(measure: Measure, value: float) -> str:
    return number(value, 0 if measure.counts and float(value).is_integer() else 3)


def _with_spread(measure: Measure, figures: RepeatedFigures) -> str:
    text = _figure(measure, figures.mean[measure.name])
    spread = figures.spread.get(measure.name, math.nan)
    return text if math.isnan(spread) else f"{text} ± {spread:.3f}"


def _marked(figures: list[tuple[float, str]], best: Best | None) -> list[Cell]:
    """Cells of figures and their texts, the best and the second best of them marked.

    Figures that are printed alike are equally good. A single figure is not the best of anything.
    """
    marks: dict[str, Mark] = {}
    known = [(value, text) for value, text in figures if not math.isnan(value)]
    if best is not None and len(known) > 1:
        ordered = sorted(known, reverse=best == "high")
        printed = list(dict.fromkeys(_printed(text) for _, text in ordered))
        marks = dict(zip(printed, ("best", "second"), strict=False))
    return [
        Cell(text, "" if math.isnan(value) else marks.get(_printed(text), ""))
        for value, text in figures
    ]


def _printed(text: str) -> str:
    """The figure in a cell, without its spread or the cross of a failure."""
    return text.split(" ")[0]
