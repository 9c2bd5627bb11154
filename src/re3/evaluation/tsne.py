"""The recurrent state over time, drawn flat: t-SNE of the LSTM's cells and outputs (Re3, Fig. 2).

A state is the vector of all cell and output values of the LSTM after a frame. As the images of
a clip change little by little, so do the states, and each clip becomes a path.

A model that returns to its first state every so many frames (Re3, sec. III-C) makes a path that
breaks off there; `recorder(..., reset=False)` leaves the returns out.
"""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence as Items
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.engine import load_engine
from re3.evaluation.plots_style import look, new_figure, plain, require, styles
from re3.result import Result
from re3.tracker import Tracker

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERPLEXITY = 30.0
"""Of t-SNE, the number of neighbours a point minds; a third of the points where there are fewer."""
SEED = 0
STATE_PARTS = ("_cell", "_output")
"""What the names of an LSTM's arrays end in; a template, say, is no part of it."""


class StatefulTracker(Protocol):
    """What is asked of a tracker: `re3.Tracker` has it."""

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> Result: ...

    def update(self, frame: NDArray[np.uint8]) -> Result: ...

    def save_state(self) -> dict[str, NDArray]: ...


@dataclass(frozen=True, eq=False)
class StatePath:
    """The states of one clip.

    Attributes:
        name: the clip's.
        states: float32 `[T, D]`, one a frame from the start on.
        occluded: `[T]`, where the dataset marks occlusion; None where it marks nothing.
        breaks: indices of the frames after which the state was that of the first frame again, so
            that no path leads there from the frame before.
    """

    name: str
    states: NDArray[np.float32]
    occluded: NDArray[np.bool_] | None = None
    breaks: tuple[int, ...] = ()


def recorder(model: str, *, reset: bool = True, threads: int = 0) -> Tracker:
    """A tracker whose states are to be recorded.

    Args:
        model: a name or a file, as `re3.Tracker` takes it.
        reset: return to the first state every so many frames, as when tracking.
        threads: of the engine; 0 takes one fewer than there are cores, 4 at most.

    Raises:
        ValueError, FileNotFoundError: unknown model.
    """
    engine = load_engine(model, threads=threads)
    if not reset:
        engine.spec = replace(engine.spec, reset_interval=0)
    return Tracker(engine=engine)


def record(
    name: str,
    frames: Iterable[NDArray[np.uint8]],
    box_xywh: ArrayLike,
    tracker: StatefulTracker,
    occluded: NDArray[np.bool_] | None = None,
) -> StatePath:
    """Track an object and keep the state after each frame.

    Args:
        name: of the clip.
        frames: uint8 `[H, W, 3]` BGR, from the one with the box on.
        box_xywh: `[4]`, the object in the first frame, in pixels.
        tracker: is started anew.
        occluded: `[T]` or longer, marks from the first frame on.

    Raises:
        ValueError: no frame, an unusable box, or a tracker without LSTM.
    """
    states: list[NDArray[np.float32]] = []
    breaks: list[int] = []
    steps = 0
    for index, frame in enumerate(frames):
        if index == 0:
            tracker.init(frame, box_xywh)
        else:
            tracker.update(frame)
        saved = tracker.save_state()
        states.append(state_vector(saved))
        # Counted from the last return to the first state.
        steps_before, steps = steps, _steps_of(saved)
        if steps < steps_before or (index and steps == steps_before and steps > 0):
            breaks.append(index)
    if not states:
        raise ValueError(f"clip {name!r} has no frames to track through; expected one or more")
    marks = None if occluded is None else np.asarray(occluded, dtype=bool)[: len(states)]
    return StatePath(name, np.stack(states), marks, tuple(breaks))


def _steps_of(saved: dict[str, NDArray]) -> int:
    """Steps of the one object since its state was last the first one."""
    found = [int(value) for key, value in saved.items() if key.endswith("/steps")]
    return max(found, default=0)


def state_vector(saved: dict[str, NDArray]) -> NDArray[np.float32]:
    """The cells and outputs `[D]` of the one object in what `save_state()` returned.

    Raises:
        ValueError: no object, or no LSTM in its state.
    """
    parts = [
        values
        for key, values in sorted(saved.items())
        if "/state/" in key and key.endswith(STATE_PARTS)
    ]
    if not parts:
        raise ValueError(
            f"the saved state has no LSTM; expected arrays */state/* that end in "
            f"{' or '.join(STATE_PARTS)}, found {', '.join(sorted(saved))}"
        )
    return np.concatenate([np.ravel(part) for part in parts]).astype(np.float32)


def embed(paths: Items[StatePath], perplexity: float = PERPLEXITY) -> list[NDArray[np.float64]]:
    """t-SNE of all states together, started from their principal components.

    Returns:
        positions `[T, 2]` for each path; the same for the same states.

    Raises:
        ImportError: the extra `report` is not installed.
        ValueError: fewer than five states, or a perplexity that is not above 0.
    """
    states = np.concatenate([path.states for path in paths]) if paths else np.empty((0, 1))
    if len(states) < 5:
        raise ValueError(f"{len(states)} states are too few for t-SNE; expected 5 frames or more")
    if not perplexity > 0:
        raise ValueError(f"perplexity is {perplexity}; expected a number above 0, such as 30")
    tsne = require("sklearn.manifold").TSNE(
        n_components=2,
        perplexity=min(perplexity, (len(states) - 1) / 3),
        init="pca",
        random_state=SEED,
    )
    positions = np.asarray(tsne.fit_transform(states), dtype=np.float64)
    return np.split(positions, np.cumsum([len(path.states) for path in paths])[:-1])


def _broken_off(points: NDArray[np.float64], breaks: Items[int]) -> NDArray[np.float64]:
    """The points `[T, 2]` with a row of NaN, where a line breaks off, before each of the breaks."""
    return np.insert(points.astype(np.float64), list(breaks), np.nan, axis=0)


def tsne_plot(paths: Items[StatePath], positions: Items[NDArray[np.float64]]) -> Figure:
    """The paths, a colour and line a clip; a square where each begins, circles where occluded.

    A path breaks off where the state returns to that of the first frame.

    Args:
        paths: names and marks.
        positions: `[T, 2]` for each, from `embed`.
    """
    styled = styles(f"{index}" for index in range(len(paths)))
    with look():
        figure = new_figure(6.8, 4.8)
        axes, beside = figure.subplots(1, 2, width_ratios=[4.8, 2.0])
        for path, points, style in zip(paths, positions, styled.values(), strict=True):
            axes.plot(
                *_broken_off(points, path.breaks).T,
                color=style.colour,
                linestyle=style.line["linestyle"],
                linewidth=0.7,
                alpha=0.7,
                label=plain(path.name),
            )
            axes.scatter(*points.T, s=5, color=style.colour, zorder=3)
            axes.scatter(
                *points[:1].T, s=34, marker="s", color=style.colour, edgecolors="black", zorder=5
            )
            if path.occluded is not None and path.occluded.any():
                axes.scatter(
                    *points[path.occluded].T,
                    s=42,
                    facecolors="none",
                    edgecolors="black",
                    linewidths=0.7,
                    zorder=4,
                )
        handles, labels = axes.get_legend_handles_labels()
        handles.append(axes.scatter([], [], s=34, marker="s", color="white", edgecolors="black"))
        labels.append("first frame")
        if any(path.occluded is not None and path.occluded.any() for path in paths):
            handles.append(axes.scatter([], [], s=42, facecolors="none", edgecolors="black"))
            labels.append("occluded frame")
        beside.axis("off")
        beside.legend(handles, labels, loc="upper left", borderaxespad=0, frameon=False)
        axes.grid(visible=False)
        # Neither the directions nor the scale of t-SNE mean anything.
        axes.set(xticks=[], yticks=[], title="t-SNE of the recurrent state, frame by frame")
        axes.set(xlabel="t-SNE, first dimension", ylabel="t-SNE, second dimension")
    return figure
