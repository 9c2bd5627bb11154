"""The plots of a run: from its results to figures, dataset by dataset."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from re3.evaluation import metrics, plots
from re3.evaluation.occlusion import attribute_means
from re3.evaluation.plots import OcclusionPair, Panel, Plot, Styles
from re3.evaluation.plots_bars import Group, bar_plot, latency_plot
from re3.evaluation.plots_curves import (
    by_tracker,
    mean_curves,
    normalised_precision,
    occluded_success,
    pooled_success,
    precision,
    success,
)
from re3.evaluation.plots_style import Style, low, plain
from re3.evaluation.plots_trade_off import one_pass_trade_off, trade_off
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.summary import Run

Floats = NDArray[np.float64]


def report_plots(run: Run, styles: Styles) -> dict[str, list[Plot]]:
    """The plots of each dataset, in order of appearance; see `dataset_plots`."""
    plots_of: dict[str, list[Plot]] = {}
    slugs: set[str] = set()
    for dataset in run.datasets:
        slug = base = file_name(dataset or "sequences")
        number = 1
        # "a b" and "a-b" give the same file name.
        while slug in slugs:
            number += 1
            slug = f"{base}-{number}"
        slugs.add(slug)
        plots_of[dataset] = dataset_plots(run, dataset, slug, styles)
    return plots_of


def dataset_plots(run: Run, dataset: str, slug: str, styles: Styles) -> list[Plot]:
    """Every plot that the results of one dataset have data for.

    Args:
        run: of any protocol.
        dataset: its name, for titles.
        slug: the same for the names of files.
        styles: of all trackers of the run, the one to be shown off first.
    """
    # Means over sequences leave those out that have nothing to compare with.
    means = run.protocol.one_pass and not run.protocol.pools_boxes
    results = [
        result
        for result in run.results
        if result.sequence.dataset == dataset
        and not result.track.unscored
        and (result.comparable or not means)
    ]
    if not results:
        return []
    title = plain(dataset or "sequences")
    made = []
    if run.protocol.one_pass:
        curves = _pooled_curve if run.protocol.pools_boxes else _curves
        made += curves(title, slug, results, styles)
        made.append(one_pass_trade_off(run, title, slug, results, styles))
        made += _occlusion(title, slug, results, styles)
    made += trade_off(run, dataset, title, slug, styles)
    made += _occluded_eao(run, dataset, title, slug, styles)
    made += _bars(run, dataset, title, slug, styles)
    if run.protocol.one_pass:
        made += _attributes(title, slug, results, styles)
    times = {name: _seconds(group) for name, group in by_tracker(results).items()}
    if run.timing_is_comparable and any(values.size for values in times.values()):
        figure = latency_plot(times, styles, title=f"{title}: time of an update")
        caption = "Time in the tracker for each update, without the start and without decoding."
        made.append(Plot(f"latency-{slug}", caption, figure))
    return made


def file_name(text: str) -> str:
    """The text as a part of a file's name: letters, digits, dots, dashes and underscores."""
    return re.sub(r"[^\w.-]+", "-", text).strip("-.") or "unnamed"


def _curves(title: str, slug: str, results: list[SequenceResult], styles: Styles) -> list[Plot]:
    count = f"{title}, {_sequences(results)}"
    panels = {
        "success": (
            Panel(
                f"Success: {count}",
                "overlap threshold",
                "share of frames above",
                mean_curves(results, metrics.OVERLAP_THRESHOLDS, success, np.mean),
            ),
            "Success: share of frames whose overlap is above the threshold; "
            "in brackets the area under the curve (AUC, 21 thresholds).",
        ),
        "precision": (
            Panel(
                f"Precision: {count}",
                "distance of centres in pixels",
                "share of frames within",
                mean_curves(
                    results,
                    metrics.DISTANCE_THRESHOLDS,
                    precision,
                    lambda curve: curve[metrics.PRECISION_AT],
                ),
                "lower right",
            ),
            "Precision: share of frames whose centre lies within the distance; "
            f"in brackets the share within {metrics.PRECISION_AT} pixels.",
        ),
        "normalised-precision": (
            Panel(
                f"Normalised precision: {count}",
                "distance of centres in sizes of the object",
                "share of frames within",
                mean_curves(results, metrics.NORMALISED_THRESHOLDS, normalised_precision, np.mean),
                "lower right",
            ),
            "Normalised precision: distances measured in true widths and heights; "
            "in brackets the area under the curve.",
        ),
    }
    note = " Mean over sequences, one pass, first frame included."
    return [
        Plot(f"{name}-{slug}", caption + note, plots.curve_plot([panel], styles))
        for name, (panel, caption) in panels.items()
    ]


def _pooled_curve(
    title: str, slug: str, results: list[SequenceResult], styles: Styles
) -> list[Plot]:
    panel = Panel(
        f"Success: {title}, {_sequences(results)}",
        "overlap threshold",
        "share of boxes above",
        pooled_success(results),
    )
    caption = (
        "Success: share of boxes whose overlap is above the threshold; in brackets the area under "
        "the curve (AUC, 21 thresholds). All boxes of all sequences thrown together, one pass, "
        "first frames included."
    )
    return [Plot(f"success-{slug}", caption, plots.curve_plot([panel], styles))]


def _occlusion(title: str, slug: str, results: list[SequenceResult], styles: Styles) -> list[Plot]:
    marked = [result for result in results if result.sequence.occluded is not None]
    everywhere, occluded = pooled_success(marked), occluded_success(marked)
    if not occluded:
        return []
    corner = ("overlap threshold", "share of frames above")
    panels = [
        Panel(f"{title}: all frames", *corner, everywhere),
        Panel(f"{title}: occluded frames", *corner, occluded),
    ]
    hidden = {curve.tracker: curve.figure for curve in occluded}
    pairs = [
        OcclusionPair(curve.tracker, curve.figure, hidden[curve.tracker])
        for curve in everywhere
        if curve.tracker in hidden
    ]
    note = (
        f" Over the frames of {_sequences(marked)} with marks of occlusion, thrown together; "
        "one pass."
    )
    return [
        Plot(
            f"occlusion-success-{slug}",
            "Success over all frames (left) and over occluded frames alone (right)." + note,
            plots.curve_plot(panels, styles),
            wide=True,
        ),
        Plot(
            f"occlusion-{slug}",
            "AUC over all frames (filled) and over occluded frames (hollow)." + note,
            plots.occlusion_plot(
                pairs, styles, title=f"{title}: all and occluded frames", x_label="AUC"
            ),
        ),
    ]


def _occluded_eao(run: Run, dataset: str, title: str, slug: str, styles: Styles) -> list[Plot]:
    """Expected overlap over all frames and over occluded ones (Re3, sec. IV-E), of VOT."""
    pairs = [
        OcclusionPair(row.tracker, figures["eao"], figures["eao_occluded"])
        for row in run.tracker_rows
        if row.dataset == dataset
        and np.isfinite((figures := row.figures.mean).get("eao_occluded", np.nan))
        and np.isfinite(figures["eao"])
    ]
    if not pairs:
        return []
    caption = (
        "Expected average overlap (EAO) over all frames (filled), and with stretches weighted by "
        "their share of occluded frames (hollow)."
    )
    figure = plots.occlusion_plot(
        pairs, styles, title=f"{title}: all and occluded frames", x_label="EAO"
    )
    return [Plot(f"occlusion-{slug}", caption, figure)]


def _bars(run: Run, dataset: str, title: str, slug: str, styles: Styles) -> list[Plot]:
    """The first figure that the protocol has by sequence, where there are several sequences."""
    rows = [row for row in run.sequence_rows if row.dataset == dataset]
    if len(rows) < 2:
        return []
    present = _present(styles, (tracker for row in rows for tracker in row.figures))
    first = next(iter(present))
    measure = run.protocol.measure(run.protocol.by_sequence[0])
    bars = [
        Group(row.sequence, {name: each[measure.name] for name, each in row.figures.items()})
        for row in rows
    ]
    bars.sort(key=lambda group: low(group.figures.get(first, np.nan)), reverse=True)
    figure = bar_plot(
        bars, present, title=f"{title}: {measure.heading} by sequence", x_label=measure.heading
    )
    caption = f"{measure.heading} of each sequence, in the order of {first}."
    return [Plot(f"sequences-{slug}", caption, figure)]


def _attributes(title: str, slug: str, results: list[SequenceResult], styles: Styles) -> list[Plot]:
    rows = attribute_means(results)
    if not rows:
        return []
    figures: dict[str, dict[str, float]] = {}
    counts: dict[str, int] = {}
    for row in rows:
        figures.setdefault(row.attribute, {})[row.tracker] = row.scores.auc
        counts[row.attribute] = max(counts.get(row.attribute, 0), row.sequences)
    attributes = [Group(f"{name} ({counts[name]})", each) for name, each in figures.items()]
    present = _present(styles, by_tracker(results))
    figure = bar_plot(attributes, present, title=f"{title}: AUC by attribute", x_label="AUC")
    caption = "Mean AUC over the sequences with each attribute; their number in brackets."
    return [Plot(f"attributes-{slug}", caption, figure)]


def _seconds(results: list[SequenceResult]) -> Floats:
    return np.concatenate([result.track.update_seconds for result in results])


def _sequences(results: list[SequenceResult]) -> str:
    count = len({result.sequence.name for result in results})
    return f"{count} sequence{'s' if count > 1 else ''}"


def _present(styles: Styles, trackers: Iterable[str]) -> dict[str, Style]:
    """The styles of some trackers, in their order."""
    names = set(trackers)
    return {name: style for name, style in styles.items() if name in names}
