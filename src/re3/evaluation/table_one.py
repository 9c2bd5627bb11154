"""Table I of the paper: its own figures, its conclusions, and whether they hold for other figures.

A conclusion is that one model is better than another by the table's average. Whether it holds is
judged over the clips: they are drawn again and again with replacement, both models on the same
ones, and the middle 95 % of the differences have to be on one side of zero. That says how much
depends on the choice of clips. It does not say how much depends on the seed of the training, of
which there is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from re3.evaluation.ablation import SENSITIVITY, counted_overlaps
from re3.evaluation.sequence_result import SequenceResult

DRAWS = 2000
INTERVAL = (2.5, 97.5)
"""Percentiles of the difference between which most of its draws are."""


@dataclass(frozen=True)
class PaperFigures:
    """Figures of a model on one data set, as printed in Table I."""

    accuracy: float
    drops: int
    robustness: float
    average: float


@dataclass(frozen=True)
class PaperRow:
    """A row of Table I.

    Attributes:
        fps: frames a second, on a Titan X of 2016.
        vot: on VOT 2014.
        imagenet: on the validation set of Imagenet Video.
    """

    fps: float
    vot: PaperFigures
    imagenet: PaperFigures


PAPER = {
    "A": PaperRow(
        168.77, PaperFigures(0.61, 35, 0.90, 0.756), PaperFigures(0.55, 471, 0.95, 0.750)
    ),
    "B": PaperRow(
        168.77, PaperFigures(0.55, 41, 0.89, 0.718), PaperFigures(0.56, 367, 0.96, 0.760)
    ),
    "C": PaperRow(
        213.27, PaperFigures(0.48, 67, 0.82, 0.651), PaperFigures(0.49, 738, 0.92, 0.706)
    ),
    "D": PaperRow(
        213.27, PaperFigures(0.57, 43, 0.88, 0.726), PaperFigures(0.60, 450, 0.95, 0.776)
    ),
    "E": PaperRow(
        213.27, PaperFigures(0.60, 38, 0.89, 0.747), PaperFigures(0.65, 359, 0.96, 0.806)
    ),
    "F": PaperRow(
        160.72, PaperFigures(0.62, 29, 0.92, 0.769), PaperFigures(0.69, 320, 0.97, 0.828)
    ),
    "G": PaperRow(
        149.63, PaperFigures(0.66, 29, 0.92, 0.789), PaperFigures(0.68, 257, 0.97, 0.826)
    ),
    "H": PaperRow(
        149.63, PaperFigures(0.60, 28, 0.92, 0.761), PaperFigures(0.71, 233, 0.97, 0.842)
    ),
    "I": PaperRow(
        149.63, PaperFigures(0.58, 61, 0.82, 0.700), PaperFigures(0.52, 1096, 0.88, 0.700)
    ),
    "J": PaperRow(
        149.63, PaperFigures(0.54, 47, 0.87, 0.705), PaperFigures(0.61, 539, 0.94, 0.775)
    ),
    "K": PaperRow(77.29, PaperFigures(0.68, 27, 0.92, 0.802), PaperFigures(0.69, 274, 0.97, 0.830)),
}
"""The paper's own figures."""


@dataclass(frozen=True)
class Conclusion:
    """What the paper concludes from two rows (sec. IV-D).

    Attributes:
        claim: in words.
        better, worse: letters of the rows.
    """

    claim: str
    better: str
    worse: str


CONCLUSIONS = (
    Conclusion("an LSTM alone, trained as before, hinders", "B", "C"),
    Conclusion("own predictions are necessary", "D", "C"),
    Conclusion("simulated data help", "E", "D"),
    Conclusion("skip connections help", "F", "E"),
    Conclusion("a second LSTM layer helps", "G", "F"),
    Conclusion("a second source of videos helps on new objects", "G", "H"),
    Conclusion("a large source of videos is needed", "G", "I"),
    Conclusion("the reset helps", "G", "J"),
    Conclusion("other convolutions do better", "K", "G"),
)

Judgement = Literal["holds", "does not hold", "undecided"]


@dataclass(frozen=True)
class Verdict:
    """Whether a conclusion holds for the figures at hand.

    Attributes:
        conclusion: of the paper.
        difference: of the averages, better less worse.
        low, high: of that difference, over draws of the clips.
    """

    conclusion: Conclusion
    difference: float
    low: float
    high: float

    @property
    def judgement(self) -> Judgement:
        """`undecided` where other clips might have said otherwise."""
        if self.low > 0:
            return "holds"
        return "does not hold" if self.high < 0 else "undecided"

    def paper_difference(self, of: Literal["vot", "imagenet"]) -> float:
        """The same difference in the paper's own table."""
        better, worse = PAPER[self.conclusion.better], PAPER[self.conclusion.worse]
        return float(getattr(better, of).average - getattr(worse, of).average)


def judge(results: dict[str, list[SequenceResult]], seed: int = 0) -> list[Verdict]:
    """Judge every conclusion of which both rows are there.

    Args:
        results: letter -> results on the same clips in the same order, run with the protocol
            `ablation`.
        seed: of the draws.

    Raises:
        ValueError: results on different clips.
    """
    verdicts = []
    for conclusion in CONCLUSIONS:
        if conclusion.better in results and conclusion.worse in results:
            pair = (results[conclusion.better], results[conclusion.worse])
            verdicts.append(_verdict(conclusion, pair, seed))
    return verdicts


def _verdict(
    conclusion: Conclusion,
    pair: tuple[list[SequenceResult], list[SequenceResult]],
    seed: int,
) -> Verdict:
    clips = [[(r.sequence.dataset, r.sequence.name) for r in results] for results in pair]
    if clips[0] != clips[1]:
        raise ValueError(
            f"{conclusion.better} and {conclusion.worse} ran on different clips; expected the same"
        )
    better, worse = (np.array([_tally(result) for result in results]) for results in pair)
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(len(better), np.full(len(better), 1 / len(better)), DRAWS)
    differences = _averages(better, drawn) - _averages(worse, drawn)
    whole = np.ones((1, len(better)))
    low, high = np.nanpercentile(differences, INTERVAL)
    return Verdict(
        conclusion,
        float((_averages(better, whole) - _averages(worse, whole))[0]),
        float(low),
        float(high),
    )


def _tally(result: SequenceResult) -> tuple[float, float, float, float]:
    """Of a clip: sum of the overlaps, how many count, drops, annotated frames."""
    assert result.supervised is not None, "of the protocol ablation"
    if result.supervised.unscored:
        return 0.0, 0.0, 0.0, 0.0
    overlaps = counted_overlaps(result.supervised, result.sequence)
    return (
        float(overlaps.sum()),
        float(len(overlaps)),
        float(result.supervised.drops),
        float(result.sequence.annotated.sum()),
    )


def _averages(
    tallies: NDArray[np.float64], times: NDArray[np.float64] | NDArray[np.int64]
) -> NDArray[np.float64]:
    """The table's average for each draw: tallies `[S, 4]`, how often each clip `[D, S]`."""
    overlaps, counted, drops, frames = (times @ tallies).T  # [D] each
    with np.errstate(invalid="ignore"):
        averages: NDArray[np.float64] = (
            overlaps / counted + np.exp(-SENSITIVITY * drops / frames)
        ) / 2
    return averages
