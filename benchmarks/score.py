"""What the score is worth: how well it tells good boxes from failures, on annotated clips.

    python benchmarks/score.py ../shared/data/val
    python benchmarks/score.py clips --hide 0 --hide 20 --leave-out mislabelled

Prints the area under the ROC curve for "overlap below 0.2", the calibration error, and, for
candidate thresholds, which share of failures falls below each and of good boxes, and which share of
losses is noticed within 10 frames; and which clips the failures are of. Then the same for frames in
which the object is not in sight: where the annotation says so, or, with `--hide N`, where something
hides it for N frames. Last what is called uncertain or lost, by the rule of `re3.confidence`, whose
values were chosen from this. A loss is the first of five frames or more on end without overlap; an
object that is hidden is lost as well. An alarm is the first of the frames on end that are called
so, a false one if its box is good. The tracker does not search for what it has lost here, so that
all models are judged on where they go by themselves.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from re3.confidence import ScoreMemory
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
    parser.add_argument(
        "--hide",
        action="append",
        type=int,
        help="frames that each object is hidden for, 0 for none; repeat for clips of several kinds",
    )
    parser.add_argument("--leave-out", action="append", default=[], help="name of a clip")
    arguments = parser.parse_args()
    sequences = [s for d in arguments.data for s in read_folder(d)]
    if unknown := set(arguments.leave_out) - {sequence.name for sequence in sequences}:
        parser.error(f"no clip {', '.join(sorted(unknown))} to leave out in what was given")
    sequences = [s for s in sequences if s.name not in arguments.leave_out]
    clips = [s for n in arguments.hide or [0] for s in (hide(sequences, [n]) if n else sequences)]
    tracks = collect(clips, arguments.model)
    scores = np.concatenate([track.scores for track in tracks])
    overlaps = np.concatenate([track.overlaps for track in tracks])
    absent = np.concatenate([track.absent_scores for track in tracks])
    failed, good = overlaps < FAILURE, overlaps >= GOOD
    losses = [(track.scores, start) for track in tracks for start in find_losses(track.overlaps)]
    print(
        f"{len(tracks)} tracks, {len(scores)} boxes, {failed.mean():.1%} failures, "
        f"{good.mean():.1%} good, {len(losses)} losses"
    )
    most = Counter({t.name: 0 for t in tracks})
    for track in tracks:
        most[track.name] += int((track.overlaps < FAILURE).sum())
    print(
        "failures in", ", ".join(f"{name} {count}" for name, count in most.most_common() if count)
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
    print("called             failures  losses noticed  not in sight  good, of 1,000  false alarms")
    for name, worst in (("uncertain or lost", Status.TRACKED), ("lost", Status.UNCERTAIN)):
        _print_called(name, worst, tracks)


def _print_called(name: str, worst: Status, tracks: list[Scores]) -> None:
    """What is called worse than a status."""
    failures: list[bool] = []
    noticed: list[bool] = []
    gone: list[bool] = []
    right: list[bool] = []
    alarms = 0
    for track in tracks:
        called = _worse(track.statuses, worst)
        absent = track.absent
        known, overlap = called[~absent], track.overlaps
        failures += list(known[overlap < FAILURE])
        right += list(known[overlap >= GOOD])
        gone += list(called[absent])
        noticed += [known[t : t + NOTICED_WITHIN].any() for t in find_losses(overlap)]
        if track.hidden_from is not None:
            noticed.append(called[track.hidden_from :][:NOTICED_WITHIN].any())
        begins = called & ~np.concatenate([[False], called[:-1]])
        alarms += int((begins[~absent] & (overlap >= GOOD)).sum())
    print(
        f"{name:17}  {_share(failures):8.1%}  {_share(noticed):8.1%} of {len(noticed):2}  "
        f"{_share(gone):12.1%}  {1000 * _share(right):14.1f}  {1000 * alarms / len(right):12.2f}"
    )


def _share(found: list[bool]) -> float:
    return float(np.mean(found)) if found else np.nan


def _worse(statuses: list[Status], than: Status) -> NDArray[np.bool_]:
    order = list(Status)
    return np.array([order.index(s) > order.index(than) for s in statuses], dtype=bool)


class Scores(NamedTuple):
    """Of one track: all boxes but the first that have a truth, or of which nothing is in sight.

    Attributes:
        name: of the clip.
        scores, overlaps: of those that have a truth.
        absent_scores: of those of which nothing is in sight.
        statuses: of either kind, in order.
        absent: which of these are of the second.
        hidden_from: the first of these that is hidden by us; None where nothing is.
    """

    name: str
    scores: Values
    overlaps: Values
    absent_scores: Values
    statuses: list[Status]
    absent: NDArray[np.bool_]
    hidden_from: int | None


def collect(sequences: list[Sequence], model: str) -> list[Scores]:
    """Scores of every box after the first, track by track, without a search."""
    factory = find_tracker(f"{model}@no-search").factory
    assert factory is not None
    tracks = []
    for sequence in sequences:
        track = run_one_pass(factory, sequence)
        overlap = iou_xywh(track.boxes_xywh, sequence.boxes_xywh)
        after = int(np.argmax(np.isfinite(overlap))) + 1
        overlap, scores = overlap[after:], track.scores[after:]
        absent, hidden_from = ~np.isfinite(overlap), None
        if isinstance(sequence, HiddenSequence):
            hidden_from = sequence.hidden_from - after
            absent[hidden_from : sequence.hidden_to - after] = True
        tracks.append(
            Scores(
                sequence.name,
                scores[~absent],
                overlap[~absent],
                scores[absent],
                _statuses(scores),
                absent,
                hidden_from,
            )
        )
    return tracks


def _statuses(scores: Values) -> list[Status]:
    """What the tracker calls each box."""
    memory, statuses = ScoreMemory(), []
    for score in scores:
        statuses.append(memory.status(score))
        memory = memory.after(score)
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
