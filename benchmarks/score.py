"""What the score is worth: how well it tells good boxes from failures, on annotated clips.

    python benchmarks/score.py ../shared/data/val
    python benchmarks/score.py clips --hide 20

Prints the area under the ROC curve for "overlap below 0.2", the calibration error, and, for
candidate thresholds, which share of failures falls below each and of good boxes, and which share of
losses is noticed within 10 frames. Then the same for frames in which the object is not in sight:
where the annotation says so, or, with `--hide N`, where something hides it for N frames. Last what
is called uncertain or lost, by the rule of `re3.confidence`, whose values were chosen from this.
A loss is the first of five frames or more on end without overlap. The tracker does not search for
what it has lost here, so that all models are judged on where they go by themselves.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from re3.confidence import USUAL_AT_FIRST, status_of, usual_after
from re3.data.hiding import HiddenSequence, hide
from re3.data.plain import read_folder
from re3.data.sequence import Sequence
from re3.evaluation.one_pass import run_one_pass
from re3.evaluation.peers import find_tracker
from re3.geometry import iou_xywh
from re3.models import DEFAULT_MODEL
from re3.result import Status

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
    parser.add_argument("--hide", type=int, default=0, help="frames that each object is hidden for")
    arguments = parser.parse_args()
    sequences = [s for d in arguments.data for s in read_folder(d)]
    if arguments.hide:
        sequences = hide(sequences, [arguments.hide])
    tracks = collect(sequences, arguments.model)
    scores = np.concatenate([track.scores for track in tracks])
    overlaps = np.concatenate([track.overlaps for track in tracks])
    absent = np.concatenate([track.absent_scores for track in tracks])
    failed, good = overlaps < FAILURE, overlaps >= GOOD
    losses = [(track.scores, start) for track in tracks for start in find_losses(track.overlaps)]
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
    if len(absent):
        print(f"{len(absent)} boxes of objects that are not in sight")
        both = np.concatenate([absent, scores[good]])
        gone = np.arange(len(both)) < len(absent)
        print(f"ROC AUC for not in sight against good: {roc_auc(-both, gone):.3f}")
    print("called             failures  losses noticed  not in sight  good, of 1,000")
    for name, worst in (("uncertain or lost", Status.TRACKED), ("lost", Status.UNCERTAIN)):
        called = np.concatenate([_worse(track.statuses, worst) for track in tracks])
        gone = np.concatenate([_worse(track.absent_statuses, worst) for track in tracks])
        noticed = [
            _worse(track.statuses[start : start + NOTICED_WITHIN], worst).any()
            for track in tracks
            for start in find_losses(track.overlaps)
        ]
        print(
            f"{name:17}  {called[failed].mean():8.1%}  {np.mean(noticed):14.1%}  "
            f"{gone.mean() if len(gone) else np.nan:12.1%}  {1000 * called[good].mean():14.1f}"
        )


def _worse(statuses: list[Status], than: Status) -> NDArray[np.bool_]:
    order = list(Status)
    return np.array([order.index(s) > order.index(than) for s in statuses], dtype=bool)


class Scores(NamedTuple):
    """Of one track: of the boxes that have a truth, and of those where nothing is in sight."""

    scores: Values
    statuses: list[Status]
    overlaps: Values
    absent_scores: Values
    absent_statuses: list[Status]


def collect(sequences: list[Sequence], model: str) -> list[Scores]:
    """Scores of every box after the first, track by track, without a search."""
    factory = find_tracker(f"{model}@no-search").factory
    assert factory is not None
    tracks = []
    for sequence in sequences:
        track = run_one_pass(factory, sequence)
        overlap = iou_xywh(track.boxes_xywh, sequence.boxes_xywh)
        known = np.isfinite(overlap)
        absent = ~known
        absent[: np.argmax(known)] = False
        known[np.argmax(known)] = False
        if isinstance(sequence, HiddenSequence):
            absent[sequence.hidden_from : sequence.hidden_to] = True
            known &= ~absent
        statuses = _statuses(track.scores)
        tracks.append(
            Scores(
                track.scores[known],
                [s for s, keep in zip(statuses, known, strict=True) if keep],
                overlap[known],
                track.scores[absent],
                [s for s, keep in zip(statuses, absent, strict=True) if keep],
            )
        )
    return tracks


def _statuses(scores: Values) -> list[Status]:
    """What the tracker calls each box; NaN before the first is passed over."""
    usual, statuses = USUAL_AT_FIRST, []
    for score in scores:
        statuses.append(status_of(score, usual))
        usual = usual_after(usual, score)
    return statuses


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
