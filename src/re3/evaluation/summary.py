"""A run as a whole: where its results come from, its figures, and what to know besides them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from re3.evaluation.environment import Environment
from re3.evaluation.one_pass import Latency, decode_time, frames_per_second, latency
from re3.evaluation.protocol import Figures, Protocol, RepeatedFigures, over_repeats
from re3.evaluation.sequence_result import SequenceResult, grouped
from re3.evaluation.time_parts import TimeParts, time_parts


@dataclass(frozen=True, eq=False)
class TrackerRow:
    """One tracker on one dataset.

    Attributes:
        dataset, tracker: their names.
        sequences: how many were run, each counted once.
        failed: how many runs broke off.
        figures: of the protocol.
        fps: updates over the time that all of them took.
        latency: percentiles of that time.
        decode_seconds: median time to read a frame.
        parts: where the time of a frame goes.
    """

    dataset: str
    tracker: str
    sequences: int
    failed: int
    figures: RepeatedFigures
    fps: float
    latency: Latency
    decode_seconds: float
    parts: TimeParts


@dataclass(frozen=True, eq=False)
class SequenceRow:
    """All trackers on one sequence.

    Attributes:
        dataset, sequence: their names; of a protocol with many starts that of the clip.
        frames: length of the sequence, of the longest where there are many.
        figures: tracker -> figures of the protocol, of repetitions their mean; NaN where there is
            nothing to score.
        failed: trackers that stopped before the end.
    """

    dataset: str
    sequence: str
    frames: int
    figures: dict[str, Figures]
    failed: frozenset[str]


@dataclass(frozen=True, eq=False)
class Run:
    """The results of a run and where they come from.

    Attributes:
        command: what was typed.
        data: the folders given.
        environment: machine, date, versions.
        protocol: that trackers were run with.
        jobs: how many ran at the same time; with more than one, times say nothing of a tracker.
        results: as `re3.evaluation.runner.run` gives them.
        remarks: what else a reader must know, a sentence each.
    """

    command: str
    data: tuple[str, ...]
    environment: Environment
    protocol: Protocol
    jobs: int
    results: list[SequenceResult]
    remarks: tuple[str, ...] = ()

    @property
    def datasets(self) -> list[str]:
        """Their names, in order of appearance."""
        return list(dict.fromkeys(result.sequence.dataset for result in self.results))

    @property
    def trackers(self) -> list[str]:
        """Their names, in order of appearance."""
        return list(dict.fromkeys(result.tracker for result in self.results))

    @property
    def timing_is_comparable(self) -> bool:
        """Each tracker had the machine to itself."""
        return self.jobs <= 1

    @cached_property
    def tracker_rows(self) -> list[TrackerRow]:
        """A row for each dataset and tracker, in order of appearance."""
        rows = []
        for (dataset, tracker), group in grouped(self.results).items():
            tracks = [result.track for result in group]
            rows.append(
                TrackerRow(
                    dataset=dataset,
                    tracker=tracker,
                    sequences=len({result.sequence.name for result in group}),
                    failed=sum(track.failure is not None for track in tracks),
                    figures=over_repeats(self.protocol, group),
                    fps=frames_per_second(tracks),
                    latency=latency(tracks),
                    decode_seconds=decode_time(tracks),
                    parts=time_parts(tracks),
                )
            )
        return rows

    @cached_property
    def sequence_rows(self) -> list[SequenceRow]:
        """A row for each sequence, in order of appearance."""
        groups: dict[tuple[str, str], dict[str, list[SequenceResult]]] = {}
        for result in self.results:
            row = (result.sequence.dataset, self.protocol.row_of(result.sequence))
            trackers = groups.setdefault(row, {})
            trackers.setdefault(result.tracker, []).append(result)
        return [
            SequenceRow(
                dataset=dataset,
                sequence=name,
                frames=max(len(result.sequence) for group in trackers.values() for result in group),
                figures={tracker: self.figures_of(group) for tracker, group in trackers.items()},
                failed=frozenset(
                    tracker
                    for tracker, group in trackers.items()
                    if any(result.track.failure is not None for result in group)
                ),
            )
            for (dataset, name), trackers in groups.items()
        ]

    def figures_of(self, results: list[SequenceResult]) -> Figures:
        """The protocol's figures of one tracker's results; NaN where there is nothing to score."""
        scored = [result for result in results if not result.track.unscored]
        if not scored:
            return {measure.name: math.nan for measure in self.protocol.measures}
        return over_repeats(self.protocol, scored).mean


def notes(run: Run) -> list[str]:
    """What a reader must know besides the figures, a sentence each."""
    said = list(run.remarks)
    for result in run.results:
        if result.track.failure is None:
            continue
        if result.track.unscored:
            meaning = "left out of the figures"
        elif run.protocol.one_pass:
            meaning = "the frames from there on count as missed"
        else:
            meaning = "counted as a failure there, and not started again"
        name, failure = result.sequence.name, result.track.failure
        said.append(f"{result.tracker} failed on {name}, {failure}; {meaning}")
    said += _without_truth(run)
    if run.tracker_rows and all(math.isnan(r.figures.mean.get("eao", 0)) for r in run.tracker_rows):
        said.append(
            "no EAO: no stretch is as long as the challenge's shortest length; give --interval "
            "LOW,HIGH for shorter sequences"
        )
    said += _reused(run.results)
    if not run.timing_is_comparable:
        said.append(
            f"{run.jobs} sequences ran at the same time, so no speeds are given: they would not "
            "be those of a tracker that has the machine to itself; measure them with --jobs 1"
        )
    return said


def _without_truth(run: Run) -> list[str]:
    """What to say of sequences that have truth in the frame of the start alone."""
    if not run.protocol.one_pass or run.protocol.pools_boxes:
        return []
    names = [result.sequence.name for result in run.results if not result.comparable]
    names = list(dict.fromkeys(names))
    if not names:
        return []
    return [
        f"{len(names)} sequence{'s have' if len(names) > 1 else ' has'} truth in the frame of the "
        "start alone, so that there is nothing to compare with; left out of the figures: "
        f"{', '.join(names[:5])}" + (" ..." if len(names) > 5 else "")
    ]


def _reused(results: list[SequenceResult]) -> list[str]:
    if len(results) > 1 and all(result.reused for result in results):
        return [f"all {len(results)} results were taken from an earlier run, boxes and times"]
    return [
        f"{reused} of {len(group)} results of {tracker} on {dataset} were taken from an "
        "earlier run, boxes and times"
        for (dataset, tracker), group in grouped(results).items()
        if (reused := sum(result.reused for result in group))
    ]
