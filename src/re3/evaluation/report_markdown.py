"""A run as Markdown: `report.md`."""

from __future__ import annotations

from re3.evaluation.markdown import markdown_code, markdown_table, markdown_text
from re3.evaluation.report_tables import (
    TextTable,
    occlusion_tables,
    sequence_tables,
    speed_tables,
    summary_table,
    time_tables,
)
from re3.evaluation.summary import Run, notes


def to_markdown(run: Run) -> str:
    """The whole report: where the figures come from, a section a dataset, and remarks."""
    environment = run.environment
    versions = ", ".join(f"{name} {version}" for name, version in environment.versions.items())
    lines = [
        f"# {run.protocol.title}",
        "",
        f"- command: {markdown_code(run.command)}",
        f"- data: {', '.join(map(markdown_code, run.data))}",
        f"- machine: {environment.cpu}, {environment.cores} cores, {environment.system}, "
        f"load {environment.load:.1f} before the run",
        f"- sequences at the same time: {run.jobs or 1}",
        f"- date: {environment.date}",
        f"- versions: {versions}",
        "",
        run.protocol.conventions,
    ]
    if run.timing_is_comparable:
        lines.append(
            "FPS: updates over the time that all of them took, without starts and decoding; 95 % "
            "of updates take no longer than p95."
        )
    for dataset in run.datasets:
        summary = summary_table(run, dataset)
        lines += ["", f"## {markdown_text(summary.title)}", "", *_table(summary)]
        for table in (
            *speed_tables(run, dataset),
            *time_tables(run, dataset),
            *sequence_tables(run, dataset),
        ):
            lines += ["", f"### {markdown_text(table.title)}", "", *_table(table)]
    for table in occlusion_tables(run):
        lines += ["", f"## {markdown_text(table.title)}", "", *_table(table)]
    if said := notes(run):
        lines += ["", "## Remarks", "", *(f"- {markdown_text(note)}" for note in said)]
    return "\n".join(lines) + "\n"


def _table(table: TextTable) -> list[str]:
    return markdown_table(table.header, [[cell.text for cell in row] for row in table.rows])
