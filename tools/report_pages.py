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
    """A page that `re3 eval` wrote.

    Raises:
        ValueError: there is no dataset in it.
    """
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
