"""FPS against the number of objects and against the side of the crop."""

from __future__ import annotations

from typing import TYPE_CHECKING

from re3.benchmark.advice import VIDEO_RATE
from re3.benchmark.study import Study
from re3.evaluation.plots_style import look, new_figure, plain, styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def speed_plot(study: Study) -> Figure:
    """One pair of axes for objects and, where crops were measured, one for them.

    Raises:
        ImportError: matplotlib is not installed.
    """
    panels = 2 if study.by_crop else 1
    with look():
        figure = new_figure(4.6 * panels, 3.8)
        axes = figure.subplots(1, panels, squeeze=False)[0]
        _by_objects(axes[0], study)
        if study.by_crop:
            _by_crop(axes[1], study)
        figure.suptitle(f"{study.environment.cpu}, {study.environment.cores} cores", fontsize=8)
    return figure


def _by_objects(axes: Axes, study: Study) -> None:
    look_of = styles(entry.name for entry in study.plan.entries)
    for name, style in look_of.items():
        timings = study.of(name)
        axes.plot(
            list(timings),
            [timing.fps for timing in timings.values()],
            label=plain(name),
            marker=style.marker,
            markersize=4,
            **style.line,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(list(study.timings), [str(objects) for objects in study.timings])
    # Rates that people think in; a logarithmic axis names powers of ten alone.
    rates = [1, 2, 5, 10, 20, 30, 60, 120, 240, 500, 1000]
    low, high = axes.get_ylim()
    shown = [rate for rate in rates if low <= rate <= high]
    axes.set_yticks(shown, [str(rate) for rate in shown])
    axes.minorticks_off()
    _camera(axes)
    axes.legend()
    axes.set(title="Speed by number of objects", xlabel="objects", ylabel="frames a second")


def _by_crop(axes: Axes, study: Study) -> None:
    sizes = sorted(study.by_crop)
    (style,) = styles(["re3-lite"]).values()
    speeds = [study.by_crop[size].fps for size in sizes]
    axes.plot(sizes, speeds, marker=style.marker, markersize=4, **style.line)
    axes.set_xticks(sizes)
    axes.set_ylim(bottom=0)
    _camera(axes)
    axes.set(
        title="Speed by side of the crop, one object",
        xlabel="side of the crop, pixels",
        ylabel="frames a second",
    )


def _camera(axes: Axes) -> None:
    """A line at the rate of a camera."""
    axes.axhline(VIDEO_RATE, color="#888888", linewidth=0.8, linestyle=":", zorder=1)
