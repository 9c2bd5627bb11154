"""What the score is worth: how well it tells good boxes from failures, on annotated clips.

    python benchmarks/score.py ../shared/data/val

Prints the area under the ROC curve for "overlap below 0.2", the calibration error, and, for
candidate thresholds, which share of failures falls below each and of good boxes, and which share of
losses is noticed within 10 frames. The thresholds of `re3.tracker` were chosen from this table.
A loss is the first of five frames or more on end without overlap. The tracker does not search for
what it has lost here, so that all models are judged on where they go by themselves.
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

LASTING = 5
"""Frames on end that make a loss."""

NOTICED_WITHIN = 10
"""Frames in which a loss should be noticed."""

Values = NDArray[np.float64]


def main() -> None:
    """Run the model over the clips and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+", type=Path)
    parser.add_argument("--model", default=DEFAULT_MODEL)
    arguments = parser.parse_args()
    tracks = collect([s for d in arguments.data for s in read_folder(d)], arguments.model)
    scores = np.concatenate([track[0] for track in tracks])
    overlaps = np.concatenate([track[1] for track in tracks])
    failed, good = overlaps < FAILURE, overlaps >= GOOD
    losses = [(scores, start) for scores, overlaps in tracks for start in find_losses(overlaps)]
    print(
        f"{len(tracks)} tracks, {len(scores)} boxes, {failed.mean():.1%} failures, "
        f"{good.mean():.1%} good, {len(losses)} losses"
    )
    print(f"ROC AUC for failure: {roc_auc(-scores, failed):.3f}")
    print(
        f"expected calibration error against the overlap: {calibration_error(scores, overlaps):.3f}"
    )
    print("threshold  failures below  losses noticed  good below, of 1,000")
    for threshold in np.arange(0.1, 0.85, 0.05):
        below = scores < threshold
        noticed = [(s[t : t + NOTICED_WITHIN] < threshold).any() for s, t in losses]
        print(
            f"{threshold:9.2f}  {below[failed].mean():14.1%}  {np.mean(noticed):14.1%}  "
            f"{1000 * below[good].mean():20.1f}"
        )


def collect(sequences: list, model: str) -> list[tuple[Values, Values]]:
    """Score and overlap of every box after the first that has a truth, track by track."""
    factory = find_tracker(f"{model}@no-search").factory
    assert factory is not None
    tracks = []
    for sequence in sequences:
        track = run_one_pass(factory, sequence)
        overlap = iou_xywh(track.boxes_xywh, sequence.boxes_xywh)
        known = np.isfinite(overlap)
        known[np.argmax(known)] = False
        tracks.append((track.scores[known], overlap[known]))
    return tracks


def find_losses(overlaps: Values) -> list[int]:
    """Indices of the frames in which the object was lost for good, or for a while."""
    failed = np.concatenate([[False], overlaps < FAILURE, [False]]).astype(int)
    starts, ends = np.flatnonzero(np.diff(failed) == 1), np.flatnonzero(np.diff(failed) == -1)
    return [int(start) for start, end in zip(starts, ends, strict=True) if end - start >= LASTING]


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
