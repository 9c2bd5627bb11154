"""Accuracy, robustness and speed of the trackers of a run, against each other (Re3, Fig. 3)."""

from __future__ import annotations

import numpy as np

from re3.evaluation.one_pass import frames_per_second
from re3.evaluation.plots import Plot, Styles, TradeOff, trade_off_plot
from re3.evaluation.plots_curves import by_tracker, overlaps_of
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.summary import Run

_SIZES = " The larger a point, the faster the tracker; hollow where the speed is unknown."


def trade_off(run: Run, dataset: str, title: str, slug: str, styles: Styles) -> list[Plot]:
    """The protocol's own accuracy and robustness on a dataset; nothing where it has neither."""
    if run.protocol.trade_off is None:
        return []
    accuracy, robustness = run.protocol.trade_off
    points = [
        TradeOff(
            tracker=row.tracker,
            accuracy=row.figures.mean[accuracy.measure],
            robustness=row.figures.mean[robustness.measure],
            fps=row.fps if run.timing_is_comparable else np.nan,
        )
        for row in run.tracker_rows
        if row.dataset == dataset
    ]
    figure = trade_off_plot(
        points,
        styles,
        title=f"{title}: accuracy, robustness and speed ({run.protocol.name})",
        accuracy_label=accuracy.label,
        robustness_label=robustness.label,
    )
    caption = f"{run.protocol.title}. Up, {accuracy.label}; to the right, {robustness.label}."
    return [Plot(f"trade-off-{slug}", caption + _SIZES, figure)]


def one_pass_trade_off(
    run: Run, title: str, slug: str, results: list[SequenceResult], styles: Styles
) -> Plot:
    """What comes nearest in one pass: mean overlap, and the share of frames with any overlap.

    Args:
        run: what the results are of.
        title, slug: the dataset's name, for people and for the name of files.
        results: on the dataset; one or more.
        styles: of their trackers.
    """
    pooled = run.protocol.pools_boxes  # over all frames together, in place of over sequences
    points = []
    for tracker, group in by_tracker(results).items():
        followed = [overlaps[1:] for overlaps in map(overlaps_of, group) if len(overlaps) > 1]
        if followed:
            tracks = [np.concatenate(followed)] if pooled else followed
            accuracy = float(np.mean([overlaps.mean() for overlaps in tracks]))
            robustness = float(np.mean([(overlaps > 0).mean() for overlaps in tracks]))
            timed = [result.track for result in group] if run.timing_is_comparable else []
            fps = frames_per_second(timed)
            points.append(TradeOff(tracker, accuracy, robustness, fps))
    # Sequences of a single frame leave nothing to follow, but the plot keeps its place.
    points = points or [TradeOff(t, np.nan, np.nan, np.nan) for t in by_tracker(results)]
    figure = trade_off_plot(
        points,
        styles,
        title=f"{title}: accuracy, robustness and speed",
        accuracy_label="mean overlap, one pass",
        robustness_label="share of frames with overlap > 0, one pass",
    )
    means = "over the frames of all sequences together" if pooled else "means over sequences"
    caption = (
        "Of one pass without restarts: the mean overlap and the share of frames with any overlap, "
        f"{means}, first frame left out. These are not VOT's accuracy and robustness."
    )
    return Plot(f"trade-off-{slug}", caption + _SIZES, figure)
