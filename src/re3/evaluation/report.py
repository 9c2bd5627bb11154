"""The results of a run as files: JSON, CSV, Markdown, one HTML page, and plots for a paper.

The parts are in modules of their own: `report_data` (JSON, CSV), `report_tables` and
`report_markdown` (tables), `plots_results` (plots), `html_report` (the page).
"""

from __future__ import annotations

from pathlib import Path

from re3.evaluation.report_data import results_csv, results_json
from re3.evaluation.report_markdown import to_markdown
from re3.evaluation.result_files import write_whole
from re3.evaluation.summary import Run


def write_reports(run: Run, folder: Path, tracker: str | None = None) -> list[Path]:
    """Write everything: `results.json`, `results.csv`, `report.md`, `report.html`, `plots/`.

    Text comes first and needs nothing beyond re3 itself; plots and the page need the extra
    `report`. Frames of the sequences that the tracker lost are read again for the page.

    Args:
        run: with at least one result.
        folder: made where it does not exist; files of these names are replaced.
        tracker: whose losses the page shows; the first by default.

    Returns:
        the files, in the order they were written.

    Raises:
        ImportError: the extra `report` is not installed; the text files are written by then.
        ValueError: no results, or none of a tracker of that name.
    """
    if not run.results:
        raise ValueError("a report without results; expected one or more")
    if tracker is not None and tracker not in run.trackers:
        raise ValueError(
            f"no results of tracker {tracker!r}; there are some of {', '.join(run.trackers)}"
        )
    texts = {
        "results.json": results_json(run),
        "results.csv": results_csv(run),
        "report.md": to_markdown(run),
    }
    written = []
    for name, text in texts.items():
        write_whole(folder / name, text)
        written.append(folder / name)
    # Deferred: they import matplotlib and Jinja.
    from re3.evaluation.html_report import to_html
    from re3.evaluation.plots_results import report_plots
    from re3.evaluation.plots_style import save, styles

    look = styles(run.trackers)
    plots = report_plots(run, look)
    write_whole(folder / "report.html", to_html(run, plots, look, tracker))
    written.append(folder / "report.html")
    for plot in (plot for each in plots.values() for plot in each):
        written += [
            save(plot.figure, folder / "plots" / f"{plot.name}{suffix}")
            for suffix in (".svg", ".pdf")
        ]
    return written
