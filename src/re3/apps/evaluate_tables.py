"""What `re3 eval` prints on standard output: tables of figures, notes, and the trackers known."""

from __future__ import annotations

import sys

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from re3.evaluation.peers import TrackerInfo
from re3.evaluation.report_tables import (
    TextTable,
    occlusion_tables,
    sequence_tables,
    summary_table,
    time_tables,
)
from re3.evaluation.summary import Run, notes

PIPE_WIDTH = 160


def show_run(run: Run, *, occluded: bool = False) -> None:
    """Print the figures of each dataset, then what to know besides them.

    Args:
        run: with at least one result.
        occluded: also compare all frames with occluded ones.
    """
    # A file or a pipe has no width to keep to; without one Rich would cut tables at 80 columns.
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    for table in console_tables(run, occluded=occluded):
        console.print(table)
    for note in notes(run):
        console.print(f"note: {note}", markup=False, highlight=False)


def console_tables(run: Run, *, occluded: bool = False) -> list[Table]:
    """Of each dataset its figures, where the time goes and, of several sequences, the first figure
    by sequence."""
    tables = []
    for dataset in run.datasets:
        tables.append(rich_table(summary_table(run, dataset)))
        tables += [
            rich_table(table, _titled(dataset, table)) for table in time_tables(run, dataset)
        ]
        by_sequence = sequence_tables(run, dataset)[0]
        if len(by_sequence.rows) > 1:
            tables.append(rich_table(by_sequence, _titled(dataset, by_sequence)))
    if occluded:
        tables += map(rich_table, occlusion_tables(run))
    return tables


def show_trackers(infos: list[TrackerInfo]) -> None:
    """Print the trackers known by name, and why one cannot be run."""
    table = Table("tracker", "what it is", "available")
    for info in infos:
        table.add_row(info.name, info.about, info.missing or "yes")
    Console().print(table)


def _titled(dataset: str, table: TextTable) -> str:
    return f"{dataset or 'sequences'}: {table.title}"


def rich_table(text: TextTable, title: str | None = None) -> Table:
    """Names first, figures after; that of one pass is narrow enough for 80 columns."""
    title = escape(text.title if title is None else title)
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for index, heading in enumerate(text.header):
        # A figure with its spread may be broken at the sign, any other not at all.
        broken = any("±" in row[index].text for row in text.rows)
        if index == 0:
            table.add_column(escape(heading), overflow="fold")
        else:
            table.add_column(escape(heading), justify="right", no_wrap=not broken)
    for row in text.rows:
        table.add_row(*(escape(cell.text) for cell in row))
    return table
