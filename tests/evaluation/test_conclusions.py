"""The paper's Table I as it is kept here, and the judgement of its conclusions."""

import json
import math

import numpy as np
import pytest

from re3.evaluation.ablation import Ablation, ablation, robustness
from re3.evaluation.environment import Environment
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.supervised import Step, SupervisedTrack
from re3.evaluation.table_one import CONCLUSIONS, PAPER, judge
from re3.evaluation.table_one_report import Row, StudyReport, report_json, report_markdown

IMAGENET_BOXES = 273_505
SIDE = 10.0


@pytest.mark.parametrize("letter", PAPER)
def test_the_papers_figures_fit_each_other(letter):
    row = PAPER[letter]
    for figures in (row.vot, row.imagenet):
        # Averages were taken before the figures were rounded.
        assert figures.average == pytest.approx(
            (figures.accuracy + figures.robustness) / 2, abs=0.0101
        )
    assert row.imagenet.robustness == pytest.approx(
        robustness(row.imagenet.drops, IMAGENET_BOXES), abs=0.011
    )


@pytest.mark.parametrize(
    ("claim", "vot", "imagenet"),
    [
        ("an LSTM alone, trained as before, hinders", 0.067, 0.054),
        ("own predictions are necessary", 0.075, 0.070),
        ("simulated data help", 0.021, 0.030),
        ("skip connections help", 0.022, 0.022),
        ("a second LSTM layer helps", 0.020, -0.002),
        ("a second source of videos helps on new objects", 0.028, -0.016),
        ("a large source of videos is needed", 0.089, 0.126),
        ("the reset helps", 0.084, 0.051),
        ("other convolutions do better", 0.013, 0.004),
    ],
)
def test_the_papers_own_differences(sequence_of, claim, vot, imagenet):
    (conclusion,) = (one for one in CONCLUSIONS if one.claim == claim)
    results = {
        letter: run(sequence_of, [0.5] * 3) for letter in (conclusion.better, conclusion.worse)
    }
    (verdict,) = judge(results)
    assert verdict.conclusion == conclusion
    assert verdict.paper_difference("vot") == pytest.approx(vot)
    assert verdict.paper_difference("imagenet") == pytest.approx(imagenet)


def run(sequence_of, overlaps, dropped=()):
    """Results on a clip each of 20 frames, with such an overlap after the first frame."""
    results = []
    for index, overlap in enumerate(overlaps):
        truth = np.tile([0.0, 0.0, SIDE, SIDE], (20, 1))
        boxes = truth.copy()
        boxes[1:, 2] *= overlap  # narrower
        steps = np.full(20, Step.FOLLOWED, np.int8)
        steps[0] = Step.STARTED
        if index in dropped:
            steps[19], boxes[19] = Step.FAILED, np.nan
        track = SupervisedTrack(boxes, steps, np.full(20, 0.01))
        results.append(SequenceResult.of("x", sequence_of(truth, name=f"clip{index}"), track))
    return results


@pytest.mark.parametrize(
    ("better", "worse", "judgement"),
    [
        ([0.8, 0.7, 0.9], [0.5, 0.4, 0.6], "holds"),
        ([0.5, 0.4, 0.6], [0.8, 0.7, 0.9], "does not hold"),
        ([0.9, 0.3, 0.6], [0.3, 0.8, 0.5], "undecided"),  # it depends on the clips
        ([0.6, 0.6, 0.6], [0.6, 0.6, 0.6], "undecided"),
    ],
)
def test_a_conclusion_is_judged_over_the_clips(sequence_of, better, worse, judgement):
    results = {"D": run(sequence_of, better), "C": run(sequence_of, worse)}
    (verdict,) = judge(results)
    assert verdict.conclusion.claim == "own predictions are necessary"
    assert verdict.judgement == judgement
    whole = ablation(results["D"]).average - ablation(results["C"]).average
    assert verdict.difference == pytest.approx(whole)
    assert verdict.low <= verdict.difference <= verdict.high


def test_drops_count_as_in_the_table(sequence_of):
    results = {"D": run(sequence_of, [0.6] * 4), "C": run(sequence_of, [0.6] * 4, dropped=(1, 2))}
    (verdict,) = judge(results)
    lost = robustness(2, 80)
    accuracy = (0.6 * 19 + 1) / 20, (0.6 * 19 * 4 - 1.2 + 4) / 80
    assert verdict.difference == pytest.approx((accuracy[0] + 1 - accuracy[1] - lost) / 2)


def test_different_clips_are_not_compared(sequence_of):
    results = {"D": run(sequence_of, [0.5, 0.5]), "C": run(sequence_of, [0.5])}
    with pytest.raises(ValueError, match="D and C ran on different clips"):
        judge(results)


def report_of(results):
    training = {
        "iterations": 7,
        "seconds": 90.0,
        "pairs": 42,
        "last_overlap": 0.5,
        "sources": {"mine, videos": 0.4, "stills, stills": 0.6},
    }
    rows = tuple(
        Row(letter, "about", 20.0, ablation(found), 1_234, 2_500_000_000, "C", training)
        for letter, found in results.items()
    )
    environment = Environment("a cpu", 2, 0.5, "Linux", "2026-01-01", {"re3": "0"})
    return StudyReport(
        "lite",
        "re3 ablate",
        {"seed": 0, "minutes": None, "data": ("a", "b")},
        environment,
        "Conventions.",
        3,
        rows,
        ("K",),
        tuple(judge(results)),
    )


def test_the_report_has_our_figures_beside_the_papers(sequence_of):
    results = {"C": run(sequence_of, [0.4] * 3), "D": run(sequence_of, [0.8] * 3)}
    text = report_markdown(report_of(results))
    (row,) = (line for line in text.splitlines() if line.startswith("| D | about"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[2:7] == ["20.0", "0.810", "0", "1.000", "0.905"]
    assert cells[7:12] == ["213.27", "0.57", "43", "0.88", "0.726"]
    assert cells[12:] == ["0.60", "450", "0.95", "0.776"]
    assert "Not ready yet: K." in text
    assert "Holds: own predictions are necessary." in text
    assert "| own predictions are necessary | D > C | holds | +0.190 |" in text
    assert "| C | 1,234 | 2.50 | C | 7 | 1.5 | 42 | 0.500 | mine, videos 40%;" in text


def test_the_report_without_anything_to_compare(sequence_of):
    text = report_markdown(report_of({"G": run(sequence_of, [0.5])}))
    assert "No two rows that the paper compares are ready." in text


def test_the_json_is_strict(sequence_of):
    report = report_of({"C": run(sequence_of, [0.4]), "D": run(sequence_of, [0.8])})
    undefined = Ablation(math.nan, 0, math.nan, math.nan, 0)
    broken = StudyReport(
        **{**vars(report), "rows": (Row("G", "g", math.nan, undefined, 1, 1, "G", {}),)}
    )
    values = json.loads(json.dumps(report_json(broken), allow_nan=False))
    assert values["rows"][0]["figures"]["accuracy"] is None
    assert values["rows"][0]["paper"]["vot"]["average"] == 0.789
    assert values["verdicts"][0]["judgement"] == "holds"
    assert values["verdicts"][0]["paper_vot"] == 0.075
