"""Figures out of the pages that `re3 eval` printed, as they lie in docs/."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
ACCURACY = DOCS / "benchmarks.md"
SPEED = DOCS / "benchmarks-speed.md"
HIDDEN = DOCS / "benchmarks-hidden.md"
ABSENT = DOCS / "benchmarks-absent.md"

Rows = list[list[str]]


@dataclass(frozen=True)
class ReportPage:
    """A report.

    Attributes:
        head: what stands at its top: command, data, machine, date, versions.
        datasets: name -> its tables by their heading, the first by "".
    """

    head: dict[str, str]
    datasets: dict[str, dict[str, Rows]]

    def folders(self) -> list[str]:
        """`val/davis` of ../shared/data/val/davis: of every dataset, in their order."""
        paths = re.findall(r"`([^`]+)`", self.head["data"])
        return ["/".join(path.split("/")[-2:]) for path in paths]


def read_page(path: Path) -> ReportPage:
    """A page that `re3 eval` wrote, with the trackers that were measured later.

    Those are in a page of their own beside it, `benchmarks-added.md` beside `benchmarks.md`; a
    tracker that both have is taken from the first.

    Raises:
        ValueError: there is no dataset in it.
    """
    page, later = _read(path), path.with_name(f"{path.stem}-added.md")
    if later.is_file():
        added = _read(later).datasets
        for name, tables in page.datasets.items():
            for heading, table in added.get(name, {}).items():
                if heading in tables:
                    add = add_rows if heading == "" else add_columns
                    tables[heading] = add(tables[heading], table)
    return page


def add_rows(table: Rows, more: Rows) -> Rows:
    """A table with the rows of another that it lacks, under its own headings."""
    known = {row[0] for row in table}
    new = [dict(zip(more[0], row, strict=True)) for row in more[1:] if row[0] not in known]
    return [*table, *([row.get(name, "-") for name in table[0]] for row in new)]


def add_columns(table: Rows, more: Rows) -> Rows:
    """A table with the columns of another that it lacks; rows are found by their first cell."""
    new = [name for name in more[0] if name not in table[0]]
    cells = {row[0]: dict(zip(more[0], row, strict=True)) for row in more}
    return [[*row, *(cells.get(row[0], {}).get(name, "-") for name in new)] for row in table]


def _read(path: Path) -> ReportPage:
    before, *sections = re.split(r"^## ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    head = dict(re.findall(r"^- ([a-z ]+): (.*)$", before, flags=re.MULTILINE))
    datasets = {}
    for section in sections:
        if not re.match(r"\S+: \d+ sequences?, ", section):
            continue  # of all datasets together
        first, *others = re.split(r"^### ", section, flags=re.MULTILINE)
        tables = {other.splitlines()[0]: _rows(other) for other in others}
        datasets[section.partition(":")[0]] = {"": _rows(first), **tables}
    if not datasets:
        raise ValueError(f"{path} has no figures of any dataset; expected a report of `re3 eval`")
    return ReportPage(head, datasets)


def column(table: Rows, name: str) -> dict[str, str]:
    """First cell of each row -> its cell under a heading."""
    index = table[0].index(name)
    return {row[0]: row[index] for row in table[1:]}


def _rows(text: str) -> Rows:
    """The first table of a text, its heading first, without the line below that."""
    found = re.search(r"(^\|.*\n?)+", text, flags=re.MULTILINE)
    lines = found[0].splitlines() if found else []
    return [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in (*lines[:1], *lines[2:])
    ]
