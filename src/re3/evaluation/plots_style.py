"""How plots look: one colour, line and marker a tracker, the same in every plot of a report.

Colours are those of Okabe and Ito (jfly.uni-koeln.de/color), which people with any of the common
kinds of colour blindness tell apart, without the yellow, too faint for a line on white.
"""

from __future__ import annotations

import importlib
import io
import math
import re
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

PALETTE = ("#D55E00", "#0072B2", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#000000")
DASHES: tuple[tuple[float, ...], ...] = (
    (),
    (4.0, 1.6),
    (1.2, 1.2),
    (6.0, 1.6, 1.2, 1.6),
    (9.0, 2.0, 1.2, 2.0, 1.2, 2.0),
)
MARKERS = ("o", "s", "^", "D", "P")
LEGEND_WIDTH = 2.0
"""Inches kept for a legend beside the axes."""
FIRST_WIDTH = 2.4
OTHER_WIDTH = 1.3

_LOOK: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#444444",
    "axes.grid": True,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "figure.dpi": 100,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "Helvetica"],
    "font.size": 9,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.fontsize": 7.5,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "#cccccc",
    "path.simplify_threshold": 0.1,
    "savefig.bbox": "tight",
    "savefig.dpi": 200,
    # Text stays text: searchable in a browser, editable in a drawing program, small.
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "re3",
}


@dataclass(frozen=True)
class Style:
    """How one tracker is drawn.

    Attributes:
        colour: "#rrggbb".
        dashes: points on, off, on, ...; empty for a solid line.
        marker: of a point, in matplotlib's letters.
        width: of a line, in points.
    """

    colour: str
    dashes: tuple[float, ...]
    marker: str
    width: float

    @property
    def line(self) -> dict[str, Any]:
        """What matplotlib's `plot` takes to draw a line."""
        dashes = (0, self.dashes) if self.dashes else "-"
        return {"color": self.colour, "linestyle": dashes, "linewidth": self.width}


def styles(names: Iterable[str]) -> dict[str, Style]:
    """A style for each name, by its place in the order; the first is drawn bolder.

    The first 35 differ in colour or in line and marker; from then on styles come again.
    """
    ordered = list(dict.fromkeys(names))
    return {
        name: Style(
            colour=PALETTE[index % len(PALETTE)],
            dashes=DASHES[index // len(PALETTE) % len(DASHES)],
            marker=MARKERS[index // len(PALETTE) % len(MARKERS)],
            width=OTHER_WIDTH if index else FIRST_WIDTH,
        )
        for index, name in enumerate(ordered)
    }


def require(module: str) -> ModuleType:
    """Import a module of the extra `report`.

    Raises:
        ImportError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f"plots and HTML reports need {module.partition('.')[0]} ({error}); "
            'pip install "re3[report]"'
        ) from error


def look() -> AbstractContextManager[None]:
    """A context in which figures are made and saved with the settings above.

    Raises:
        ImportError: matplotlib is not installed.
    """
    context: AbstractContextManager[None] = require("matplotlib").rc_context(_LOOK)
    return context


def new_figure(width: float, height: float) -> Figure:
    """An empty figure in inches; without pyplot, so that nothing global is left behind."""
    figure: Figure = require("matplotlib.figure").Figure(
        figsize=(width, height), layout="constrained"
    )
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as .svg, .pdf or .png; the same figure gives the same file.

    Raises:
        ValueError: another suffix.
    """
    suffix = path.suffix.lower()
    check_suffix(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix)
    with look():
        figure.savefig(path, format=suffix[1:], metadata=undated)
    return path


def check_suffix(path: Path) -> None:
    """Raises ValueError where a figure cannot be written to a file of that name."""
    if path.suffix.lower() not in (".svg", ".pdf", ".png"):
        raise ValueError(f"{path} does not end in .svg, .pdf or .png; give one of these")


def inline_svg(figure: Figure, prefix: str) -> str:
    """A figure as an `<svg>` element to be put into a page.

    Args:
        prefix: put before every id in it: a page may not have one twice, and the clip paths of
            one figure would be taken for those of another.
    """
    buffer = io.StringIO()
    with look():
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r'\bid="', f'id="{prefix}-', text)
    text = re.sub(r'(href="|url\()#', rf"\1#{prefix}-", text)
    return text.strip()


def legend_beside(beside: Axes, axes: Axes) -> Legend:
    """The legend of some axes, in others that hold nothing else.

    A legend hung outside its own axes is not always made room for.
    """
    beside.axis("off")
    handles, labels = axes.get_legend_handles_labels()
    # matplotlib lists lines before bars; the bar is the tracker that comes first.
    order = sorted(range(len(handles)), key=lambda i: not isinstance(handles[i], tuple))
    return beside.legend(
        [handles[i] for i in order],
        [labels[i] for i in order],
        loc="upper left",
        bbox_to_anchor=(0, 1),
        borderaxespad=0,
        handlelength=3.0,
        frameon=False,
    )


def legend_height(entries: int) -> float:
    """Inches that a legend with so many entries takes."""
    return 0.3 + 0.157 * entries


def plain(name: str) -> str:
    """A name as matplotlib prints it unchanged."""
    # matplotlib takes dollars for mathematics, and leaves labels with a leading underscore out.
    shown = name.replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown


def low(value: float) -> float:
    """A figure for sorting: what is undefined (NaN) comes below everything."""
    return -math.inf if math.isnan(value) else value
