"""Curves and points of an evaluation, from plain figures: of any protocol, any number of trackers.

Each function takes what is to be drawn as small dataclasses, and the styles of
`re3.evaluation.plots_style.styles`, and returns a matplotlib figure; matplotlib is imported when
the first is made (extra `report`).
"""

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
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Styles = Mapping[str, Style]

LEGEND_INSIDE = 8
"""Longer legends go beside the axes."""
SLOWEST_SHOWN = 3.0
"""Frames a second; slower trackers are drawn as large as this, to be visible (Re3, Fig. 3)."""


@dataclass(frozen=True, eq=False)
class Plot:
    """A figure of a report.

    Attributes:
        name: of its files, unique in the report.
        caption: what it shows and how it was computed.
        figure: of matplotlib.
        wide: takes the whole width of a page, not a column.
    """

    name: str
    caption: str
    figure: Figure
    wide: bool = False


@dataclass(frozen=True, eq=False)
class Curve:
    """One tracker in a success or precision plot.

    Attributes:
        tracker: its name.
        x, y: `[N]`.
        figure: what the legend says of it and is sorted by, 0..1.
    """

    tracker: str
    x: Floats
    y: Floats
    figure: float


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes with curves.

    Attributes:
        title, x_label, y_label: what is written to it.
        curves: one a tracker.
        legend_at: the corner that curves leave free, in matplotlib's words.
    """

    title: str
    x_label: str
    y_label: str
    curves: Items[Curve]
    legend_at: str = "lower left"


@dataclass(frozen=True)
class TradeOff:
    """One tracker by accuracy, robustness (0..1) and speed (frames a second, NaN if unknown)."""

    tracker: str
    accuracy: float
    robustness: float
    fps: float


@dataclass(frozen=True)
class OcclusionPair:
    """One tracker over all frames and over the occluded ones, 0..1."""

    tracker: str
    everywhere: float
    occluded: float


def curve_plot(panels: Items[Panel], styles: Styles) -> Figure:
    """Success or precision plots, one pair of axes a panel (Wu et al., CVPR 2013; Re3, Fig. 6).

    Raises:
        ValueError: no panel, or one without curves.
    """
    if not panels or not all(panel.curves for panel in panels):
        raise ValueError("a plot of curves without any; expected one or more a panel")
    most = max(len(panel.curves) for panel in panels)
    with look():
        for_legends = LEGEND_WIDTH if most > LEGEND_INSIDE else 0.0
        height = 3.6 if not for_legends else max(3.6, legend_height(most))
        figure = new_figure((4.2 + for_legends) * len(panels), height)
        widths = [4.2, for_legends] if for_legends else [4.2]
        rows = figure.subplots(
            1, len(widths) * len(panels), squeeze=False, width_ratios=widths * len(panels)
        )
        pairs = rows[0].reshape(len(panels), len(widths))
        for pair, panel in zip(pairs, panels, strict=True):
            _curves(pair[0], panel, styles)
            if for_legends:
                legend_beside(pair[1], pair[0])
            else:
                pair[0].legend(loc=panel.legend_at, handlelength=2.6)
    return figure


def _curves(axes: Axes, panel: Panel, styles: Styles) -> None:
    best_first = sorted(panel.curves, key=lambda curve: low(curve.figure), reverse=True)
    for place, curve in enumerate(best_first):
        axes.plot(
            curve.x,
            curve.y,
            label=f"[{_number(curve.figure)}] {plain(curve.tracker)}",
            zorder=3 - place / len(best_first),
            **styles[curve.tracker].line,
        )
    ends = [curve.x for curve in panel.curves]
    axes.set_xlim(min(x[0] for x in ends), max(x[-1] for x in ends))
    axes.set_ylim(0, 1.01)
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)


def trade_off_plot(
    points: Items[TradeOff],
    styles: Styles,
    *,
    title: str,
    accuracy_label: str,
    robustness_label: str,
) -> Figure:
    """Accuracy over robustness, points larger for faster trackers (Re3, Fig. 3).

    The area of a point grows with the logarithm of the speed. A tracker of unknown speed is
    a hollow point.

    Raises:
        ValueError: no points.
    """
    if not points:
        raise ValueError("a plot of accuracy and robustness without points; expected one or more")
    with look():
        # Room for the legend of sizes below that of the trackers.
        figure = new_figure(4.8 + LEGEND_WIDTH, max(4.0, legend_height(len(points)) + 1.3))
        axes, beside = figure.subplots(1, 2, width_ratios=[4.8, LEGEND_WIDTH])
        for point in sorted(points, key=lambda p: low(p.accuracy), reverse=True):
            style = styles[point.tracker]
            known = math.isfinite(point.fps)
            axes.scatter(
                [point.robustness],
                [point.accuracy],
                s=_area(point.fps),
                marker=style.marker,
                facecolors=style.colour if known else "none",
                edgecolors="white" if known else style.colour,
                linewidths=0.8 if known else 1.4,
                alpha=0.85,
                # Small points above large ones, or they would be hidden.
                zorder=3 + 1 / _area(point.fps),
                label=f"{plain(point.tracker)} ({_speed(point.fps)})",
                clip_on=False,
            )
        axes.set(title=title, xlabel=robustness_label, ylabel=accuracy_label)
        _widen(axes)
        _trade_off_legends(axes, beside, points)
    return figure


def _trade_off_legends(axes: Axes, beside: Axes, points: Items[TradeOff]) -> None:
    """The trackers by name and, below, what the sizes mean."""
    trackers = legend_beside(beside, axes)
    for handle in trackers.legend_handles:
        handle.set_sizes([36])  # type: ignore[union-attr]
    speeds = [point.fps for point in points if math.isfinite(point.fps)]
    if not speeds:
        return
    beside.add_artist(trackers)
    shown = [fps for fps in (3.0, 30.0, 300.0) if fps <= 3.3 * max(speeds)] or [3.0]
    handles = [
        beside.scatter([], [], s=_area(fps), color="#999999", label=f"{fps:.0f} FPS")
        for fps in shown
    ]
    beside.legend(handles=handles, loc="lower left", labelspacing=1.1, frameon=False)


def occlusion_plot(
    pairs: Items[OcclusionPair], styles: Styles, *, title: str, x_label: str
) -> Figure:
    """All frames against occluded frames: two points and an arrow a tracker (Re3, Fig. 5).

    Raises:
        ValueError: no pairs.
    """
    if not pairs:
        raise ValueError("a plot of occlusion without trackers; expected one or more")
    ordered = sorted(pairs, key=lambda pair: low(pair.everywhere))
    with look():
        figure = new_figure(5.2, 1.3 + 0.24 * len(ordered))
        axes = figure.subplots()
        for row, pair in enumerate(ordered):
            style = styles[pair.tracker]
            axes.annotate(
                "",
                xy=(pair.occluded, row),
                xytext=(pair.everywhere, row),
                arrowprops={"arrowstyle": "->", "color": style.colour, "shrinkB": 4},
            )
            axes.plot([pair.everywhere], [row], style.marker, color=style.colour, markersize=6.5)
            axes.plot(
                [pair.occluded],
                [row],
                style.marker,
                markerfacecolor="white",
                markeredgecolor=style.colour,
                markersize=6.5,
            )
        axes.plot([], [], "o", color="#555555", label="all frames")
        axes.plot(
            [], [], "o", markerfacecolor="white", markeredgecolor="#555555", label="occluded frames"
        )
        axes.set_yticks(range(len(ordered)), [plain(pair.tracker) for pair in ordered])
        axes.set_ylim(-0.6, len(ordered) - 0.4)
        axes.grid(axis="y", visible=False)
        axes.set(xlabel=x_label, ylabel="tracker")
        axes.set_title(title, pad=24)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return figure


def _widen(axes: Axes) -> None:
    """Room around the points, for large ones lie half outside otherwise; never far past 0..1."""
    for limits, set_limits in (
        (axes.get_xlim(), axes.set_xlim),
        (axes.get_ylim(), axes.set_ylim),
    ):
        margin = max(0.12 * (limits[1] - limits[0]), 0.02)
        set_limits(max(limits[0] - margin, -0.02), min(limits[1] + margin, 1.02))


def _area(fps: float) -> float:
    """Area of a point in square points."""
    if not math.isfinite(fps):
        return 45.0
    return 45.0 * (1.0 + 2.2 * math.log10(max(fps, SLOWEST_SHOWN) / SLOWEST_SHOWN))


def _speed(fps: float) -> str:
    if not math.isfinite(fps):
        return "no speed"
    return f"{fps:.0f} FPS" if fps >= 10 else f"{fps:.1f} FPS"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"
