"""What the score is worth: how well it tells good boxes from failures, on annotated clips.

    python benchmarks/score.py ../shared/data/val

Prints the area under the ROC curve for "overlap below 0.2", the calibration error, and, for
candidate thresholds, which share of failures falls below each, and of good boxes. The thresholds
of `re3.tracker` were chosen from this table.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from re3.data.plain import read_folder
from re3.evaluation.one_pass import run_one_pass
from re3.evaluation.peers import find_tracker
from re3.geometry import iou_xywh
from re3.models import DEFAULT_MODEL

FAILURE = 0.2
"""A box that overlaps the object by less than this is a failure."""

GOOD = 0.5


def main() -> None:
    """Run the model over the clips and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", type=Path)
    parser.add_argument("--model", default=DEFAULT_MODEL)
    arguments = parser.parse_args()
    scores, overlaps = collect([s for d in arguments.data for s in read_folder(d)], arguments.model)
    failed, good = overlaps < FAILURE, overlaps >= GOOD
    print(f"{len(scores)} boxes, {failed.mean():.1%} failures, {good.mean():.1%} good")
    print(f"ROC AUC for failure: {roc_auc(-scores, failed):.3f}")
    print(
        f"expected calibration error against the overlap: {calibration_error(scores, overlaps):.3f}"
    )
    print("threshold  failures below  good boxes below")
    for threshold in np.arange(0.1, 0.85, 0.05):
        below = scores < threshold
        print(f"{threshold:9.2f}  {below[failed].mean():14.1%}  {below[good].mean():16.1%}")


def collect(sequences: list, model: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Score and overlap of every box after the first that has a truth."""
    factory = find_tracker(model).factory
    assert factory is not None
    scores, overlaps = [], []
    for sequence in sequences:
        track = run_one_pass(factory, sequence)
        overlap = iou_xywh(track.boxes_xywh, sequence.boxes_xywh)
        known = np.isfinite(overlap)
        known[np.argmax(known)] = False
        scores.append(track.scores[known])
        overlaps.append(overlap[known])
    return np.concatenate(scores), np.concatenate(overlaps)


def roc_auc(evidence: NDArray[np.float64], positive: NDArray[np.bool_]) -> float:
    """Probability that a positive has more evidence than a negative (Mann-Whitney)."""
    ordered = np.sort(evidence[~positive])
    below = np.searchsorted(ordered, evidence[positive], side="left")
    not_above = np.searchsorted(ordered, evidence[positive], side="right")
    return float((below + not_above).mean() / 2 / len(ordered))


def calibration_error(scores: NDArray[np.float64], overlaps: NDArray[np.float64]) -> float:
    """Mean distance between score and overlap over ten bins of the score, by their size."""
    bins = np.minimum((scores * 10).astype(int), 9)
    return float(
        sum(
            (bins == b).mean() * abs(scores[bins == b].mean() - overlaps[bins == b].mean())
            for b in np.unique(bins)
        )
    )


if __name__ == "__main__":
    main()
