"""The plot of `re3 data stats`: shares, sizes, motion, growth and occlusion of training clips."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from re3.data.survey import HIDDEN, ClipFacts, Survey, joined
from re3.evaluation.plots_style import PALETTE, look, new_figure, plain
from re3.geometry import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_CURVES = 6
"""With more sources, curves are of recorded and of simulated clips."""
_BINS = 40
_KINDS = {"videos": "recorded", "stills": "simulated"}


def stats_plot(found: Survey) -> Figure:
    """Six panels: shares of the sources, and what their clips are like.

    Raises:
        ImportError: matplotlib, of the extra `report`, is not installed.
    """
    sources = found.sources()
    groups = _groups(found)
    frames = len(found.clips[0].sizes)
    with look():
        figure = new_figure(13.5, max(6.6, 3.4 + 0.32 * len(sources)))
        axes = figure.subplots(2, 3)
        _bars(
            axes[0, 0],
            [f"{plain(s.name)} ({_KINDS[s.kind]})" for s in sources],
            {
                "by weight": [s.declared for s in sources],
                "drawn": [s.drawn for s in sources],
            },
        )
        axes[0, 0].set_title("Sources", pad=24)
        axes[0, 0].set_xlabel("share of the clips")
        sizes = {name: joined([c.sizes for c in clips]) for name, clips in groups.items()}
        _curves(axes[0, 1], sizes, np.geomspace(4.0, 800.0, _BINS + 1))
        axes[0, 1].set(title="Size of the object", xlabel="root of the box's area, pixels")
        motion = {name: joined([c.motion for c in clips]) for name, clips in groups.items()}
        _curves(axes[0, 2], motion, np.geomspace(1e-3, 5.0, _BINS + 1))
        axes[0, 2].set(title="Motion", xlabel="way in a frame, in units of the object's size")
        growth = {name: joined([c.growth for c in clips]) for name, clips in groups.items()}
        _curves(axes[1, 0], growth, np.geomspace(0.6, 1 / 0.6, _BINS + 1))
        axes[1, 0].set_xticks([0.6, 0.8, 1.0, 1.25, 1.6])
        axes[1, 0].set(title="Change of the size", xlabel="size by that in the frame before")
        hidden = {name: joined([c.hidden for c in clips]) for name, clips in groups.items()}
        _curves(axes[1, 1], hidden, np.linspace(0.0, 1.0, 21), logarithmic=False)
        axes[1, 1].set(title="Occlusion", xlabel="share of the object that is hidden", yscale="log")
        if not any(map(len, hidden.values())):
            axes[1, 1].text(
                0.5, 0.5, "nothing is known", ha="center", transform=axes[1, 1].transAxes
            )
        _bars(
            axes[1, 2],
            [f"{plain(s.name)} ({_KINDS[s.kind]})" for s in sources],
            {
                f"hidden by {HIDDEN:.0%} or more": [s.occluded for s in sources],
                "absent": [s.absent for s in sources],
            },
        )
        axes[1, 2].set_title("Frames without a clear view", pad=24)
        axes[1, 2].set_xlabel("share of the frames")
        figure.suptitle(f"{len(found.clips)} training clips of {frames} frames", fontsize=11)
    return figure


def _groups(found: Survey) -> dict[str, list[ClipFacts]]:
    """The clips that a curve is of, by name."""
    groups: dict[str, list[ClipFacts]] = {}
    by_kind = len(found.declared) > MOST_CURVES
    for source, kind in found.declared:
        groups.setdefault(_KINDS[kind] if by_kind else f"{source} ({_KINDS[kind]})", [])
    for clip in found.clips:
        told = _KINDS[clip.kind]
        groups[told if by_kind else f"{clip.source} ({told})"].append(clip)
    return groups


def _curves(
    axes: Axes, values: dict[str, Floats], edges: Floats, *, logarithmic: bool = True
) -> None:
    """A histogram a group, each adding up to 1; what lies outside counts to the outermost bins."""
    for index, (name, found) in enumerate(values.items()):
        if not len(found):
            continue
        counts, _ = np.histogram(np.clip(found, edges[0], edges[-1]), edges)
        colour = PALETTE[index % len(PALETTE)]
        axes.stairs(counts / len(found), edges, color=colour, linewidth=1.5, label=plain(name))
    if logarithmic:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.xaxis.set_minor_formatter(lambda *_: "")
    axes.set_ylabel("share of the frames")
    if axes.get_legend_handles_labels()[0]:
        axes.legend()


def _bars(axes: Axes, names: list[str], values: dict[str, list[float]]) -> None:
    """Groups of horizontal bars, the first on top; nothing where a value is NaN."""
    rows = np.arange(len(names))
    height = 0.8 / len(values)
    for index, (label, lengths) in enumerate(values.items()):
        drawn = np.nan_to_num(lengths)
        axes.barh(
            rows + (index + 0.5) * height - 0.4,
            drawn,
            height,
            color=PALETTE[index + 1],
            label=label,
        )
        for row, length in zip(rows, lengths, strict=True):
            told = "not known" if np.isnan(length) else f"{length:.1%}"
            at = float(np.nan_to_num(length))
            axes.annotate(
                told,
                (at, row + (index + 0.5) * height - 0.4),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=6.5,
            )
    axes.set_yticks(rows, names, fontsize=8)
    axes.set_ylim(len(names) - 0.5, -0.5)
    longest = np.nanmax([length for lengths in values.values() for length in lengths] or [0.0])
    axes.set_xlim(0, max(1.25 * float(np.nan_to_num(longest)), 0.02))
    axes.xaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
    axes.grid(axis="y", visible=False)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
