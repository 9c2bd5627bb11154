"""The results of a run as tables for a terminal, as Markdown and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from re3.evaluation.environment import Environment
from re3.evaluation.metrics import Scores
from re3.evaluation.one_pass import frames_per_second
from re3.evaluation.runner import SequenceResult

CONVENTIONS = (
    "One pass, started at the first annotated frame with the truth, never re-initialised. "
    "AUC: 21 thresholds, first frame included. P@20: centres within 20 pixels. "
    "NP: area under the precision curve normalised by the true size, 0 to 0.5. "
    "AO, SR.50, SR.75: first frame left out. Each figure is the mean over sequences. "
    "FPS: one over the median time of an update, without decoding."
)

Rows = tuple[list[str], list[list[str]]]
"""A table as text: its headings and its rows."""

_COLUMNS = ("AUC", "P@20", "NP", "AO", "SR.50", "SR.75")


@dataclass(frozen=True, eq=False)
class Report:
    """Results and where they come from.

    Attributes:
        command: what was typed.
        data: the folders given.
        environment: machine, date, versions.
        results: in the order of `re3.evaluation.runner.run`.
    """

    command: str
    data: tuple[str, ...]
    environment: Environment
    results: list[SequenceResult]


@dataclass(frozen=True)
class Summary:
    """One tracker on one dataset.

    Attributes:
        dataset, tracker: their names.
        sequences: how many were run.
        failed: on how many of them the tracker stopped before the end.
        scores: means over the sequences.
        fps: one over the median time of an update over all frames.
        reused: how many sequences were taken from an earlier run.
    """

    dataset: str
    tracker: str
    sequences: int
    failed: int
    scores: Scores
    fps: float
    reused: int


def summarise(results: list[SequenceResult]) -> list[Summary]:
    """One row a dataset and tracker, datasets in order of appearance, trackers likewise."""
    groups: dict[tuple[str, str], list[SequenceResult]] = {}
    for result in results:
        groups.setdefault((result.sequence.dataset, result.tracker), []).append(result)
    return [
        Summary(
            dataset=dataset,
            tracker=tracker,
            sequences=len(group),
            failed=sum(result.track.failure is not None for result in group),
            scores=Scores.mean([result.scores for result in group]),
            fps=frames_per_second(result.track for result in group),
            reused=sum(result.reused for result in group),
        )
        for (dataset, tracker), group in groups.items()
    ]


def to_tables(report: Report) -> list[Table]:
    """For a terminal: figures of each dataset, and AUC by sequence where it has several."""
    tables = []
    for name in dict.fromkeys(result.sequence.dataset for result in report.results):
        results = [result for result in report.results if result.sequence.dataset == name]
        sequences = {id(result.sequence) for result in results}
        count = f"{len(sequences)} sequence{'s' if len(sequences) > 1 else ''}"
        title = f"{name or 'sequences'}: {count}, one-pass evaluation"
        # The dataset and the number of sequences are in the title.
        tables.append(_rich(title, *_without(_summary_rows(results), {"dataset", "sequences"})))
        if len(sequences) > 1:
            rows = _sequence_rows(results, lambda scores: scores.auc)
            tables.append(_rich(f"{name}: AUC by sequence", *_without(rows, {"dataset"})))
    return tables


def to_markdown(report: Report) -> str:
    """The whole report as Markdown."""
    environment = report.environment
    versions = ", ".join(f"{name} {version}" for name, version in environment.versions.items())
    lines = [
        "# One-pass evaluation",
        "",
        f"- command: `{report.command}`",
        f"- data: {', '.join(f'`{folder}`' for folder in report.data)}",
        f"- machine: {environment.cpu}, {environment.cores} cores, {environment.system}, "
        f"load {environment.load:.1f} before the run",
        f"- date: {environment.date}",
        f"- versions: {versions}",
        "",
        *_markdown(*_summary_rows(report.results)),
        "",
        CONVENTIONS,
        "",
        "## AUC by sequence",
        "",
        *_markdown(*_sequence_rows(report.results, lambda scores: scores.auc)),
        "",
        "## Precision at 20 pixels by sequence",
        "",
        *_markdown(*_sequence_rows(report.results, lambda scores: scores.precision)),
    ]
    if notes := remarks(report):
        lines += ["", "## Remarks", "", *(f"- {note}" for note in notes)]
    return "\n".join(lines) + "\n"


def to_json(report: Report) -> str:
    """The whole report as JSON; figures that are not defined are null."""
    summary = [
        {
            "dataset": row.dataset,
            "tracker": row.tracker,
            "sequences": row.sequences,
            "failed": row.failed,
            "reused": row.reused,
            **asdict(row.scores),
            "fps": row.fps,
        }
        for row in summarise(report.results)
    ]
    sequences = [
        {
            "dataset": result.sequence.dataset,
            "sequence": result.sequence.name,
            "frames": len(result.sequence),
            "tracker": result.tracker,
            **asdict(result.scores),
            "fps": frames_per_second([result.track]),
            "failure": result.track.failure,
            "reused": result.reused,
        }
        for result in report.results
    ]
    document = {
        "command": report.command,
        "data": list(report.data),
        "environment": _without_nan(asdict(report.environment)),
        "conventions": CONVENTIONS,
        "summary": [_without_nan(row) for row in summary],
        "sequences": [_without_nan(row) for row in sequences],
    }
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def remarks(report: Report) -> list[str]:
    """What a reader must know: trackers that failed, times that are of another run."""
    notes = [
        f"{result.tracker} failed on {result.sequence.name}, {result.track.failure}; "
        "the frames from there on count as missed"
        for result in report.results
        if result.track.failure is not None
    ]
    notes += [
        f"{row.reused} of {row.sequences} sequences of {row.tracker} on {row.dataset} were taken "
        "from an earlier run, boxes and times"
        for row in summarise(report.results)
        if row.reused
    ]
    return notes


def _summary_rows(results: list[SequenceResult]) -> Rows:
    header = ["dataset", "tracker", "sequences", *_COLUMNS, "FPS", "failed"]
    rows = []
    for row in summarise(results):
        s = row.scores
        figures = (s.auc, s.precision, s.normalised_precision, s.ao, s.sr50, s.sr75)
        rows.append(
            [
                row.dataset,
                row.tracker,
                str(row.sequences),
                *(_figure(value) for value in figures),
                _speed(row.fps),
                str(row.failed) if row.failed else "",
            ]
        )
    return header, rows


def _sequence_rows(results: list[SequenceResult], figure: Callable[[Scores], float]) -> Rows:
    trackers = list(dict.fromkeys(result.tracker for result in results))
    table: dict[tuple[str, str], tuple[int, dict[str, str]]] = {}
    for result in results:
        sequence = result.sequence
        row = table.setdefault((sequence.dataset, sequence.name), (len(sequence), {}))
        # A cross marks a track that stopped before the end.
        mark = "" if result.track.failure is None else " x"
        row[1][result.tracker] = _figure(figure(result.scores)) + mark
    rows = [
        [dataset, name, str(frames), *(cells.get(tracker, "") for tracker in trackers)]
        for (dataset, name), (frames, cells) in table.items()
    ]
    return ["dataset", "sequence", "frames", *trackers], rows


def _without(rows: Rows, headings: set[str]) -> Rows:
    """The table without some of its columns."""
    keep = [index for index, heading in enumerate(rows[0]) if heading not in headings]
    return [rows[0][i] for i in keep], [[row[i] for i in keep] for row in rows[1]]


def _rich(title: str, header: list[str], rows: list[list[str]]) -> Table:
    """A terminal table: names first, figures after; narrow enough for 80 columns."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for index, heading in enumerate(header):
        if index == 0:
            table.add_column(heading, overflow="fold")
        else:
            table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _markdown(header: list[str], rows: list[list[str]]) -> list[str]:
    marks = ["---" if index < 2 else "---:" for index in range(len(header))]
    return ["| " + " | ".join(row) + " |" for row in (header, marks, *rows)]


def _figure(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


def _speed(fps: float) -> str:
    if math.isnan(fps):
        return "-"
    return f"{fps:.1f}" if fps < 100 else f"{fps:.0f}"


def _without_nan(row: dict[str, Any]) -> dict[str, Any]:
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in row.items()
    }
