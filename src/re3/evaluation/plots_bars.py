"""Bars by sequence or attribute, and histograms of the time of an update."""

from __future__ import annotations

import math
from collections.abc import Mapping
from collections.abc import Sequence as Items
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from re3.evaluation.plots_style import (
    LEGEND_WIDTH,
    Style,
    legend_beside,
    legend_height,
    look,
    low,
    new_figure,
    plain,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Styles = Mapping[str, Style]

MOST_GROUPS = 60
"""Sequences in a bar plot; of more, those with the lowest figures of the first tracker."""


@dataclass(frozen=True)
class Group:
    """A row of a bar plot: a sequence or an attribute, and each tracker's figure, 0..1."""

    name: str
    figures: Mapping[str, float]


def bar_plot(groups: Items[Group], styles: Styles, *, title: str, x_label: str) -> Figure:
    """A bar a group for the first tracker of `styles`, a marker for each of the others.

    Groups are drawn from top to bottom as given. Of more than `MOST_GROUPS`, those with the
    lowest bars are drawn, and the title says so.

    Raises:
        ValueError: no groups.
    """
    if not groups:
        raise ValueError("a bar plot without groups; expected one or more")
    first, *others = styles
    shown = list(groups)
    if len(shown) > MOST_GROUPS:
        lowest = sorted(shown, key=lambda group: low(group.figures.get(first, math.nan)))
        kept = {id(group) for group in lowest[:MOST_GROUPS]}
        shown = [group for group in shown if id(group) in kept]
        title += f"\nthe {MOST_GROUPS} lowest of {len(groups)}"
    rows = np.arange(len(shown))
    with look():
        beside_width = LEGEND_WIDTH if others else 0.1
        height = max(1.2 + 0.19 * len(shown), legend_height(len(styles)))
        figure = new_figure(4.8 + beside_width, height)
        axes, beside = figure.subplots(1, 2, width_ratios=[4.8, beside_width])
        beside.axis("off")
        values = [group.figures.get(first, math.nan) for group in shown]
        colour = styles[first].colour
        axes.barh(rows, values, height=0.68, color=colour, alpha=0.55, label=plain(first))
        for name in others:
            axes.plot(
                [group.figures.get(name, math.nan) for group in shown],
                rows,
                styles[name].marker,
                color=styles[name].colour,
                markersize=4.2,
                markeredgecolor="white",
                markeredgewidth=0.4,
                linestyle="none",
                label=plain(name),
            )
        axes.set_yticks(rows, [plain(group.name) for group in shown])
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.set_xlim(0, 1)
        axes.grid(axis="y", visible=False)
        axes.set(title=title, xlabel=x_label)
        if others:
            legend_beside(beside, axes)
    return figure


def latency_plot(seconds: Mapping[str, Floats], styles: Styles, *, title: str) -> Figure:
    """How long an update takes: a histogram a tracker, one above the other, on one log scale.

    Args:
        seconds: tracker -> `[N]`, above 0; trackers without any are left out.

    Raises:
        ValueError: no tracker has a time.
    """
    times = {name: 1000.0 * values[values > 0] for name, values in seconds.items()}
    times = {name: values for name, values in times.items() if values.size}
    if not times:
        raise ValueError("a plot of latency without times; expected one or more")
    low = min(float(values.min()) for values in times.values())
    high = max(float(values.max()) for values in times.values())
    edges = np.geomspace(low * 0.95, high * 1.05, 80)
    with look():
        figure = new_figure(6.2, 1.1 + 0.42 * len(times))
        rows = figure.subplots(len(times), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, values) in zip(rows, times.items(), strict=True):
            colour = styles[name].colour
            counts, _ = np.histogram(values, edges)
            axes.stairs(counts / counts.max(), edges, fill=True, color=colour, alpha=0.6)
            median, late = (float(value) for value in np.percentile(values, (50, 99)))
            axes.axvline(median, color=colour, linewidth=1.4)
            axes.axvline(late, color=colour, linewidth=1.0, linestyle=":")
            axes.set(xscale="log", ylim=(0, 1.1), yticks=[])
            axes.grid(axis="y", visible=False)
            axes.spines["left"].set_visible(False)
            axes.set_ylabel(plain(name), rotation=0, ha="right", va="center", fontsize=8)
            told = f"median {median:.3g} ms, p99 {late:.3g} ms"
            axes.text(1.01, 0.35, told, transform=axes.transAxes, fontsize=7)
        rows[0].set_title(title)
        rows[-1].xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        rows[-1].set_xlabel(
            "time of an update in milliseconds (line: median, dotted: 99th percentile)"
        )
    return figure
