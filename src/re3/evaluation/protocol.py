"""What an evaluation protocol is: how trackers are run, and which figures are made of that.

The protocols themselves are in `re3.evaluation.protocols`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from re3.data.sequence import Sequence
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.supervised import SupervisedConfig

Figures = dict[str, float]
"""Name of a figure -> its value, in the order of the table's columns."""


@dataclass(frozen=True)
class Measure:
    """A figure that a protocol has of every tracker.

    Attributes:
        name: of the figure in `Figures`, in JSON and in CSV.
        heading: short, for tables.
        best: whether high or low figures are good; None of one that says nothing of a tracker.
        counts: it is a number of things, printed without decimals where it is whole.
    """

    name: str
    heading: str
    best: Literal["high", "low"] | None = "high"
    counts: bool = False


@dataclass(frozen=True)
class Axis:
    """An axis of the plot of accuracy over robustness: a figure's name, and what to write to it."""

    measure: str
    label: str


@dataclass(frozen=True)
class Protocol:
    """How trackers are run and judged.

    Attributes:
        name: as it is asked for.
        title: of its tables and reports.
        conventions: what a reader of the figures has to know, in sentences.
        supervised: when a tracker is started again; None for one pass.
        summarise: the figures of one tracker on the sequences given.
        measures: the same figures in the same order, with how they are shown.
        by_sequence: names of those that are also worth a table by sequence, the first for plots.
        pools_boxes: the boxes of all sequences are thrown together; without, a figure is a mean
            over sequences.
        pools_repeats: repetitions are given to `summarise` together, as more runs of the same;
            without, the figures are the mean of those of each repetition.
        trade_off: its accuracy and its robustness, as axes of a plot; None without such figures.
        prepare: makes the sequences to run from those given; None where it is those.
        many_starts: `prepare` makes several sequences of a clip, which have its name, a slash and
            the start as theirs; a table by sequence has the clips, with the figures of all starts.
    """

    name: str
    title: str
    conventions: str
    supervised: SupervisedConfig | None
    summarise: Callable[[list[SequenceResult]], Figures]
    measures: tuple[Measure, ...]
    by_sequence: tuple[str, ...]
    pools_boxes: bool = False
    pools_repeats: bool = False
    trade_off: tuple[Axis, Axis] | None = None
    prepare: Callable[[list[Sequence]], list[Sequence]] | None = None
    many_starts: bool = False

    @property
    def one_pass(self) -> bool:
        """Each track is started once."""
        return self.supervised is None

    def row_of(self, sequence: Sequence) -> str:
        """The name under which a table by sequence has the figures of one."""
        return self.row_of_name(sequence.name)

    def row_of_name(self, name: str) -> str:
        """The same, of a sequence's name."""
        return clip_of(name) if self.many_starts else name

    def measure(self, name: str) -> Measure:
        """The measure of that name; KeyError without."""
        return {measure.name: measure for measure in self.measures}[name]


def clip_of(name: str) -> str:
    """The clip of a sequence that a protocol of many starts made of it: `blackswan/from-12`."""
    return name.rpartition("/")[0]


@dataclass(frozen=True)
class RepeatedFigures:
    """Figures of a tracker over all repetitions.

    Attributes:
        mean: the figures.
        spread: their standard deviation over repetitions (n - 1); empty with a single one.
    """

    mean: Figures
    spread: Figures


def over_repeats(protocol: Protocol, results: list[SequenceResult]) -> RepeatedFigures:
    """The figures of one tracker on some sequences.

    Args:
        protocol: they were run with.
        results: of that tracker, with all repetitions; at least one.
    """
    repeats = sorted({result.repeat for result in results})
    each = [
        protocol.summarise([result for result in results if result.repeat == repeat])
        for repeat in repeats
    ]
    if len(each) == 1:
        return RepeatedFigures(each[0], {})
    mean = (
        protocol.summarise(results)
        if protocol.pools_repeats
        else {name: float(np.mean([figures[name] for figures in each])) for name in each[0]}
    )
    spread = {name: float(np.std([f[name] for f in each], ddof=1)) for name in each[0]}
    return RepeatedFigures(mean, spread)
