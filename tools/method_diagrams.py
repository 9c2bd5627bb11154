"""Diagrams of the two networks; sizes are read from the networks' own descriptions."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from re3.evaluation.plots_style import look, new_figure
from re3.network.lite_config import LiteConfig
from re3.network.re3 import Re3Config

IMAGE, LEARNT, MEMORY, ANSWER = "#EAF2F8", "#FDEBD0", "#E8DAEF", "#D5F5E3"


def network_re3(clips: Path) -> Figure:
    """The paper's network (Re3, Fig. 1), one step."""
    del clips
    config = Re3Config()
    side = config.crop.size
    with look():
        figure, axes = _canvas(11.6, 4.4)
        top = _block(axes, 0.9, 3.2, f"previous crop\n{side} x {side}", IMAGE)
        low = _block(axes, 0.9, 1.0, f"current crop\n{side} x {side}", IMAGE)
        trunk_top = _block(axes, 3.0, 3.2, "CaffeNet\nconvolutions", LEARNT)
        trunk_low = _block(axes, 3.0, 1.0, "CaffeNet\nconvolutions", LEARNT)
        axes.text(3.0, 2.1, "the same weights", ha="center", va="center", fontsize=8.5)
        skip = "skips, 3 depths:\n1 x 1 conv, PReLU"
        skip_top = _block(axes, 5.1, 3.2, skip, LEARNT)
        skip_low = _block(axes, 5.1, 1.0, skip, LEARNT)
        full = _block(axes, 7.0, 2.1, f"fully connected\n{config.fully_connected}", LEARNT)
        lstm = _block(axes, 9.0, 2.1, f"LSTM, 2 layers\nof {config.lstm_units}", LEARNT)
        state = _block(axes, 9.0, 3.7, "recurrent state", MEMORY)
        corners = _block(axes, 10.9, 2.1, "corners\nx1 y1 x2 y2", ANSWER, width=1.4)
        for start, end in (
            (top, trunk_top),
            (low, trunk_low),
            (trunk_top, skip_top),
            (trunk_low, skip_low),
            (skip_top, full),
            (skip_low, full),
            (full, lstm),
            (lstm, corners),
        ):
            _arrow(axes, start, end)
        _arrow(axes, lstm, state, both=True)
    return figure


def network_lite(clips: Path) -> Figure:
    """`re3-lite`, one step."""
    del clips
    config = LiteConfig()
    size, grid, cells = config.current.size, config.grid, config.template_cells
    recurrence = f"FC {config.fully_connected},\nLSTM 2 x {config.lstm_units}"
    seen = f"embedding\n{config.embedding} x {grid} x {grid}"
    with look():
        figure, axes = _canvas(11.6, 5.6)
        crop = _block(axes, 0.9, 1.4, f"current crop\n{size} x {size}", IMAGE)
        trunk = _block(axes, 2.9, 1.4, "EfficientNet-Lite0\nto stride 16", LEARNT)
        embedding = _block(axes, 4.9, 1.4, seen, LEARNT)
        first = _block(axes, 4.9, 4.0, f"object, first\nframe: {cells} x {cells}", MEMORY)
        previous = _block(axes, 4.9, 2.7, f"object, previous\nframe: {cells} x {cells}", MEMORY)
        fused = _block(axes, 7.0, 2.7, "correlations,\nfused map", LEARNT)
        lstm = _block(axes, 9.0, 3.7, recurrence, LEARNT)
        state = _block(axes, 9.0, 5.0, "recurrent state", MEMORY)
        heat = _block(axes, 9.0, 1.8, "scaled, shifted:\ntwo heat maps", LEARNT)
        corners = _block(axes, 10.9, 2.4, "corners", ANSWER, width=1.2)
        score = _block(axes, 10.9, 1.2, "score", ANSWER, width=1.2)
        for start, end in (
            (crop, trunk),
            (trunk, embedding),
            (first, fused),
            (previous, fused),
            (embedding, fused),
            (fused, lstm),
            (fused, heat),
            (lstm, heat),
            (heat, corners),
            (heat, score),
        ):
            _arrow(axes, start, end)
        _arrow(axes, lstm, state, both=True)
    return figure


Block = tuple[float, float, float, float]
"""Centre and half the size."""


def _canvas(width: float, height: float) -> tuple[Figure, Axes]:
    figure = new_figure(width * 0.78, height * 0.68)
    axes = figure.add_subplot()
    axes.set(xlim=(0, width + 0.2), ylim=(0.4, height))
    axes.axis("off")
    return figure, axes


def _block(
    axes: Axes, x: float, y: float, text: str, colour: str, width: float = 1.7, height: float = 0.85
) -> Block:
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - height / 2),
            width,
            height,
            boxstyle="round,pad=0.02,rounding_size=0.08",
            facecolor=colour,
            edgecolor="#555555",
            linewidth=0.9,
        )
    )
    axes.text(x, y, text, ha="center", va="center", fontsize=8.5)
    return x, y, width / 2 + 0.04, height / 2 + 0.04


def _arrow(axes: Axes, start: Block, end: Block, both: bool = False) -> None:
    x1, y1, w1, h1 = start
    x2, y2, w2, h2 = end
    across = abs(x2 - x1) > w1 + w2
    if across:
        tail, head = (x1 + w1, y1), (x2 - w2, y2)
    else:
        up = 1 if y2 > y1 else -1
        tail, head = (x1, y1 + up * h1), (x2, y2 - up * h2)
    axes.annotate(
        "",
        xy=head,
        xytext=tail,
        arrowprops={"arrowstyle": "<->" if both else "->", "color": "#444444", "lw": 1.0},
    )
