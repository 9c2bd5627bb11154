"""Plots: what is drawn and written, without looking at pixels."""

import re
import subprocess
import sys

import numpy as np
import pytest

from re3.evaluation import plots, plots_bars
from re3.evaluation.plots import Curve, OcclusionPair, Panel, TradeOff
from re3.evaluation.plots_bars import Group
from re3.evaluation.plots_style import DASHES, PALETTE, inline_svg, save, styles

pytest.importorskip("matplotlib", reason='needs matplotlib: pip install "re3[report]"')

X = np.linspace(0, 1, 21)


def many(count):
    return [f"tracker-{index}" for index in range(count)]


def panel(figures, title="Success"):
    curves = [Curve(name, X, value * (1 - X), value) for name, value in figures.items()]
    return Panel(title, "overlap threshold", "share of frames", curves)


def legend_texts(figure):
    legends = [axes.get_legend() for axes in figure.axes if axes.get_legend() is not None]
    return [[text.get_text() for text in legend.get_texts()] for legend in legends]


def test_styles_differ_and_follow_the_order():
    first = styles(many(35))
    assert list(first) == many(35)
    assert len({(style.colour, style.dashes) for style in first.values()}) == 35
    assert len({(style.colour, style.marker) for style in first.values()}) == 35
    assert first["tracker-0"].width > first["tracker-1"].width
    # A tracker keeps its style when others are added behind it; a name counts once.
    assert styles(["tracker-0", "tracker-1", "tracker-0"])["tracker-1"] == first["tracker-1"]
    assert len(PALETTE) * len(DASHES) == 35


def test_legend_is_sorted_by_the_figure_and_says_it():
    figures = {"low": 0.25, "undefined": float("nan"), "high": 0.75}
    figure = plots.curve_plot([panel(figures)], styles(figures))
    assert legend_texts(figure) == [["[0.750] high", "[0.250] low", "[-] undefined"]]


def test_one_line_a_tracker_in_its_style():
    names = many(4)
    look = styles(names)
    figure = plots.curve_plot([panel(dict.fromkeys(names, 0.5))], look)
    (axes,) = figure.axes
    assert len(axes.lines) == 4
    for line in axes.lines:
        style = look[line.get_label().removeprefix("[0.500] ")]
        assert (line.get_color(), line.get_linewidth()) == (style.colour, style.width)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("overlap threshold", "share of frames")
    assert axes.get_title() == "Success"


def test_many_trackers_have_their_legend_beside_the_curves():
    names = many(25)
    figure = plots.curve_plot([panel(dict.fromkeys(names, 0.5))] * 2, styles(names))
    figure.draw_without_rendering()
    assert [len(texts) for texts in legend_texts(figure)] == [25, 25]
    for curves, beside in (figure.axes[:2], figure.axes[2:]):
        legend = beside.get_legend().get_window_extent()
        assert len(curves.lines) == 25
        assert legend.x0 > curves.get_window_extent().x1
        assert legend.y0 >= 0 and legend.x1 <= figure.bbox.x1


def test_trade_off_sizes_follow_the_speed():
    points = [
        TradeOff("slow", 0.5, 0.4, 1.0),
        TradeOff("three", 0.5, 0.5, 3.0),
        TradeOff("fast", 0.6, 0.7, 200.0),
        TradeOff("unknown", 0.4, 0.6, float("nan")),
    ]
    figure = plots.trade_off_plot(
        points,
        styles(p.tracker for p in points),
        title="t",
        accuracy_label="mean overlap",
        robustness_label="share of frames with overlap > 0",
    )
    axes = figure.axes[0]
    drawn = {c.get_label(): c for c in axes.collections}
    assert list(drawn) == [
        "fast (200 FPS)",
        "slow (1.0 FPS)",
        "three (3.0 FPS)",
        "unknown (no speed)",
    ]
    slow, three, fast = (drawn[k].get_sizes()[0] for k in list(drawn)[1:3] + list(drawn)[:1])
    assert slow == three < fast
    np.testing.assert_allclose(drawn["fast (200 FPS)"].get_offsets(), [[0.7, 0.6]])
    assert len(drawn["unknown (no speed)"].get_facecolors()) == 0  # hollow
    assert axes.get_xlabel() == "share of frames with overlap > 0"
    assert axes.get_ylabel() == "mean overlap"


def test_occlusion_has_two_points_a_tracker():
    pairs = [OcclusionPair("a", 0.6, 0.5), OcclusionPair("b", 0.4, 0.45)]
    figure = plots.occlusion_plot(pairs, styles("ab"), title="t", x_label="AUC")
    (axes,) = figure.axes
    points = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata())]
    assert sorted(points) == [0.4, 0.45, 0.5, 0.6]
    # The best is on top.
    assert [text.get_text() for text in axes.get_yticklabels()] == ["b", "a"]


def test_bars_of_the_first_and_markers_of_the_others():
    groups = [Group("one", {"a": 0.5, "b": 0.6}), Group("two", {"a": 0.2})]
    figure = plots_bars.bar_plot(groups, styles(["a", "b"]), title="t", x_label="AUC")
    axes = figure.axes[0]
    assert [bar.get_width() for bar in axes.patches] == [0.5, 0.2]
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), [0.6, np.nan])
    assert [text.get_text() for text in axes.get_yticklabels()] == ["one", "two"]
    assert legend_texts(figure) == [["a", "b"]]


def test_of_many_groups_the_lowest_are_shown_and_told():
    groups = [Group(f"s{index}", {"a": index / 100}) for index in range(80, 0, -1)]
    figure = plots_bars.bar_plot(groups, styles(["a"]), title="t", x_label="AUC")
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert names == [f"s{index}" for index in range(60, 0, -1)]
    assert "the 60 lowest of 80" in figure.axes[0].get_title()


def test_latency_says_median_and_tail():
    seconds = {"a": np.full(100, 0.01), "none": np.empty(0), "b": np.linspace(0.02, 0.04, 101)}
    figure = plots_bars.latency_plot(seconds, styles(seconds), title="t")
    texts = [axes.texts[0].get_text() for axes in figure.axes]
    assert texts == ["median 10 ms, p99 10 ms", "median 30 ms, p99 39.8 ms"]
    assert [axes.get_ylabel() for axes in figure.axes] == ["a", "b"]


@pytest.mark.parametrize(
    "draw",
    [
        lambda: plots.curve_plot([], {}),
        lambda: plots.curve_plot([panel({})], {}),
        lambda: plots.trade_off_plot([], {}, title="", accuracy_label="", robustness_label=""),
        lambda: plots.occlusion_plot([], {}, title="", x_label=""),
        lambda: plots_bars.bar_plot([], {}, title="", x_label=""),
        lambda: plots_bars.latency_plot({"a": np.empty(0)}, styles("a"), title=""),
    ],
)
def test_nothing_to_draw_is_an_error(draw):
    with pytest.raises(ValueError, match="expected one or more"):
        draw()


def test_names_are_printed_as_they_are(tmp_path):
    names = ["_hidden", "a$b$c", "x^2 & <b>"]
    figure = plots.curve_plot([panel(dict.fromkeys(names, 0.5))], styles(names))
    text = save(figure, tmp_path / "f.svg").read_text()
    for shown in ("_hidden", "a$b$c", "x^2 &amp; &lt;b&gt;"):
        assert f"{shown}</text>" in text


def test_files_are_the_same_every_time(tmp_path):
    for suffix in (".svg", ".pdf"):
        written = []
        for name in ("one", "two"):
            figure = plots.curve_plot([panel({"a": 0.5})], styles("a"))
            written.append(save(figure, tmp_path / "new" / f"{name}{suffix}").read_bytes())
        assert written[0] == written[1]
    with pytest.raises(ValueError, match=r"f\.jpg does not end in \.svg, \.pdf or \.png"):
        save(figure, tmp_path / "f.jpg")


def test_inline_svg_refers_to_itself_alone():
    svg = inline_svg(plots.curve_plot([panel({"a": 0.5})], styles("a")), "fig7")
    assert svg.startswith("<svg") and svg.endswith("</svg>")
    assert "http" not in svg
    identities = re.findall(r'\bid="([^"]*)"', svg)
    referred = re.findall(r"url\(#([^)]*)\)", svg) + re.findall(r'href="#([^"]*)"', svg)
    assert identities and all(name.startswith("fig7-") for name in identities)
    assert referred and set(referred) <= set(identities)


def test_matplotlib_is_not_loaded_before_it_is_needed():
    code = (
        "import sys, re3, re3.apps.cli, re3.evaluation.report, re3.evaluation.plots_results;"
        "sys.exit(bool({'matplotlib', 'sklearn', 'jinja2'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"re3\[report\]"):
        plots.curve_plot([panel({"a": 0.5})], styles("a"))
