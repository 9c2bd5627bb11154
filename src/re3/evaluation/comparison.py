"""Paired differences between trackers, from the results that `re3 eval` has written.

Two trackers are compared on the sequences that both have run. The differences of a clip's starts
are averaged first, then those of the clips; the error is that over clips
(`re3.evaluation.clip_means`). Most of the spread between clips is common to both trackers and falls
out of the difference, so its error is smaller than that of either figure.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from re3.evaluation.clip_means import MeanWithError, clip_means
from re3.evaluation.protocol import Measure, Protocol
from re3.evaluation.protocols import find_protocol

RESULTS = "results.json"

_ONE_PASS = (
    Measure("auc", "AUC"),
    Measure("sr50", "SR.50"),
    Measure("sr75", "SR.75"),
    Measure("lost", "frames lost", "low"),
    Measure("ends_lost", "ends lost", "low"),
)

SequenceKey = tuple[str, str]
"""Names of a dataset and a sequence."""


@dataclass(frozen=True)
class TrackerFigures:
    """The figures of one tracker on each sequence.

    Attributes:
        label: its name; with the folder before it where two folders have one of that name.
        tracker: its name.
        protocol: that it was run with.
        figures: name of a figure -> sequence -> value, the mean over repetitions; sequences without
            a value are left out.
    """

    label: str
    tracker: str
    protocol: Protocol
    figures: dict[str, dict[SequenceKey, float]]


@dataclass(frozen=True)
class FigureDifference:
    """One figure of two trackers.

    Attributes:
        measure: the figure.
        first, second: means over clips of either.
        difference: second minus first, over clips.
        better, worse: clips on which the second tracker is better, and worse.
    """

    measure: Measure
    first: float
    second: float
    difference: MeanWithError
    better: int
    worse: int


@dataclass(frozen=True)
class ClipDifference:
    """The first figure of two trackers on one clip: means over its sequences."""

    clip: str
    first: float
    second: float


@dataclass(frozen=True)
class Comparison:
    """Two trackers on the same sequences.

    Attributes:
        first, second: labels of the two.
        figures: of each figure that both have.
        clips: of each clip, in the order of the first tracker's results.
        left_out: sequences that only one of them has a value for.
    """

    first: str
    second: str
    figures: list[FigureDifference]
    clips: list[ClipDifference]
    left_out: int


def read_results(folders: list[Path]) -> list[TrackerFigures]:
    """The trackers in the results of some runs, in order.

    Args:
        folders: that `re3 eval --out` has written, or the JSON files themselves.

    Raises:
        FileNotFoundError: a folder holds no results.
        ValueError: a file is not one of results, or the protocols of two differ.
    """
    found = [(folder, one) for folder in folders for one in _read(folder)]
    names = [one.tracker for _, one in found]
    given = [
        TrackerFigures(
            one.tracker if names.count(one.tracker) == 1 else f"{folder}: {one.tracker}",
            one.tracker,
            one.protocol,
            one.figures,
        )
        for folder, one in found
    ]
    protocols = {one.protocol.name: one.label for one in given}
    if len(protocols) > 1:
        told = ", ".join(f"{label} by {name}" for name, label in protocols.items())
        raise ValueError(f"results of different protocols: {told}; expected the same for all")
    return given


def compare(first: TrackerFigures, second: TrackerFigures) -> Comparison:
    """The paired differences of two trackers.

    Raises:
        ValueError: no sequence has a value from both.
    """
    measures = [m for m in measures_of(first.protocol) if first.figures.get(m.name)]
    measures = [m for m in measures if second.figures.get(m.name)]
    if not measures:
        raise ValueError(f"{first.label} and {second.label} have no figure in common")
    main = measures[0].name
    left_out = len(first.figures[main].keys() ^ second.figures[main].keys())
    if not first.figures[main].keys() & second.figures[main].keys():
        raise ValueError(
            f"{first.label} and {second.label} have no sequence in common; expected results on "
            "the same data"
        )
    figures: list[FigureDifference] = []
    clips: list[ClipDifference] = []
    for measure in measures:
        pairs = _by_clip(first, second, measure.name)
        differences = [pair.second - pair.first for pair in pairs]
        gains = [d if measure.best == "high" else -d for d in differences]
        figures.append(
            FigureDifference(
                measure,
                MeanWithError.of([pair.first for pair in pairs]).mean,
                MeanWithError.of([pair.second for pair in pairs]).mean,
                MeanWithError.of(differences),
                sum(gain > 0 for gain in gains),
                sum(gain < 0 for gain in gains),
            )
        )
        clips = clips or pairs
    return Comparison(first.label, second.label, figures, clips, left_out)


def measures_of(protocol: Protocol) -> tuple[Measure, ...]:
    """The figures that a sequence has under a protocol; the first is the main one."""
    if protocol.one_pass:
        return _ONE_PASS
    return tuple(measure for measure in protocol.measures if measure.best is not None)


def _by_clip(first: TrackerFigures, second: TrackerFigures, name: str) -> list[ClipDifference]:
    """Means over the sequences of a clip that both have."""
    ours, theirs = first.figures[name], second.figures[name]
    common = [key for key in ours if key in theirs]
    # `davis-hidden-5` and `davis-hidden-10` are the same clips.
    variants = f"-{first.protocol.name}-"
    datasets = {dataset.partition(variants)[0] for dataset, _ in common}

    def clip(key: SequenceKey) -> str:
        row = first.protocol.row_of_name(key[1])
        return row if len(datasets) == 1 else f"{key[0].partition(variants)[0]}: {row}"

    one = clip_means((clip(key), ours[key]) for key in common)
    other = clip_means((clip(key), theirs[key]) for key in common)
    return [ClipDifference(name, one[name], other[name]) for name in one]


def _read(folder: Path) -> list[TrackerFigures]:
    path = folder if folder.is_file() else folder / RESULTS
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} does not exist; expected a folder that `re3 eval --out` has written"
        )
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        protocol = find_protocol(document["protocol"])
        records: list[dict[str, Any]] = document["sequences"]
        values: dict[str, dict[str, dict[SequenceKey, list[float]]]] = {}
        for record in records:
            figures = values.setdefault(record["tracker"], {})
            key = (record["dataset"], record["sequence"])
            for measure in measures_of(protocol):
                value = record.get(measure.name)
                if value is not None:
                    figures.setdefault(measure.name, {}).setdefault(key, []).append(float(value))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(
            f"{path} does not hold results of `re3 eval` ({type(error).__name__}: {error})"
        ) from error
    return [
        TrackerFigures(
            tracker,
            tracker,
            protocol,
            {
                name: {key: math.fsum(each) / len(each) for key, each in of_sequences.items()}
                for name, of_sequences in figures.items()
            },
        )
        for tracker, figures in values.items()
    ]
