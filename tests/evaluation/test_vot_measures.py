"""VOT's measures by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from re3.evaluation.supervised import Step, SupervisedTrack
from re3.evaluation.vot import (
    STACKS,
    VotRuns,
    VotStack,
    expected_overlap_curve,
    pixel_overlaps,
    score_vot,
)

NAN = (math.nan,) * 4
TRUTH = (10, 10, 20, 20)
BOXES = {
    # A letter a frame: S start, X failure, - skipped, and how well the box overlaps the truth.
    "S": (Step.STARTED, TRUTH),
    "X": (Step.FAILED, NAN),
    "-": (Step.SKIPPED, NAN),
    "1": (Step.FOLLOWED, TRUTH),
    "h": (Step.FOLLOWED, (10, 10, 20, 10)),  # half of it: 0.5
    "q": (Step.FOLLOWED, (10, 10, 10, 10)),  # a quarter: 0.25
    "d": (Step.FOLLOWED, (0, 10, 40, 20)),  # twice as wide: 0.5
}
PLAIN = VotStack("test", "test", None, burn_in=1)


def track(letters, **more):
    steps, boxes = zip(*(BOXES[letter] for letter in letters), strict=True)
    return SupervisedTrack(
        np.array(boxes, dtype=float), np.array(steps, np.int8), np.zeros(len(steps)), **more
    )


def runs(*letters, truth=TRUTH, size=(100, 100)):
    truths = np.broadcast_to(np.array(truth, dtype=float), (len(letters[0]), 4))
    return VotRuns("clip", truths, size, [track(run) for run in letters])


@pytest.mark.parametrize(
    ("box", "truth", "overlap"),
    [
        ((10, 10, 20, 20), (10, 10, 20, 20), 1.0),
        ((10, 10, 20, 20), (20, 10, 20, 20), 1 / 3),
        ((10, 10, 20, 20), (30, 10, 20, 20), 0.0),  # beside each other
        ((10.4, 10.4, 20.4, 20.4), (9.6, 9.6, 19.6, 19.6), 1.0),  # the same when rounded
        ((10.6, 10, 20, 20), (10, 10, 20, 20), 19 / 21),  # position and size rounded apart
        ((10.5, 10, 20, 20), (10, 10, 20, 20), 1.0),  # halves to the even number: 10
        ((11.5, 10, 20, 20), (10, 10, 20, 20), 18 / 22),  # and 12
        ((-10, 0, 20, 10), (0, 0, 20, 10), 0.5),  # 10 of 20 columns: the left half is outside
        ((90, 90, 20, 20), (95, 95, 20, 20), 0.25),  # cut at the right and the bottom
        ((10, 10, 0, 20), (10, 10, 20, 20), 0.0),  # without a pixel
        ((10, 10, 0.4, 20), (10, 10, 20, 20), 0.0),
        ((5, 5, 1, 1), (5, 5, 1, 9), 1.0),  # one column between them: the toolkit's quirk
        ((-9, 5, 10, 10), (-9, 5, 10, 5), 0.0),  # one column left inside: its other quirk
        ((-50, 0, 20, 20), (-50, 0, 20, 20), 0.0),  # all outside
        (NAN, TRUTH, 0.0),
        (TRUTH, NAN, 0.0),
    ],
)
def test_pixel_overlap(box, truth, overlap):
    assert pixel_overlaps([box], [truth], (100, 100)) == pytest.approx([overlap], abs=1e-12)


def test_pixel_overlap_of_many_is_that_of_each():
    random = np.random.default_rng(0)
    a, b = random.uniform(-10, 60, (2, 50, 4))
    together = pixel_overlaps(a, b, (70, 50))
    alone = [pixel_overlaps(a[i : i + 1], b[i : i + 1], (70, 50))[0] for i in range(50)]
    np.testing.assert_array_equal(together, alone)


def test_pixel_overlap_refuses_other_shapes():
    with pytest.raises(ValueError, match=r"shape \(2, 4\) and the truth \(3, 4\)"):
        pixel_overlaps(np.zeros((2, 4)), np.zeros((3, 4)), (10, 10))


@pytest.mark.parametrize(
    ("letters", "burn_in", "accuracy", "failures"),
    [
        ("S1111", 1, 1.0, 0),
        ("Shq", 1, 0.375, 0),
        ("Sd", 1, 0.5, 0),
        ("Shhh1111", 4, 1.0, 0),  # the start and three frames after it are not counted
        ("Shhh1111", 3, 4.5 / 5, 0),
        ("S1X----Shh", 1, 2 / 3, 1),  # 1, .5, .5; failures and gaps do not count
        ("S1X----Shh", 2, 0.5, 1),
        ("S1X----Shh", 10, 0.0, 1),  # no frame left
        ("SXSXS", 1, 0.0, 2),
        ("SXS", 0, 0.0, 1),
    ],
)
def test_accuracy_and_failures_of_one_run(letters, burn_in, accuracy, failures):
    scores = score_vot([runs(letters)], VotStack("test", "test", None, burn_in=burn_in))
    assert scores.accuracy == pytest.approx(accuracy, abs=1e-12)
    assert scores.robustness == scores.failures == failures
    # 30 frames of failures at this rate: exp(-30 F / N).
    assert scores.reliability == pytest.approx(math.exp(-30 * failures / len(letters)))
    assert math.isnan(scores.eao)


def test_sequences_weigh_by_frames_and_runs_alike():
    # Accuracy 1 and .5, failures 0 and 1: means .75 and .5 over 5 frames.
    first = runs("S1111", "ShXS-")
    # Accuracy .25 and no failure over 15 frames, though only 2 of them count.
    second = runs("S" + "q" * 2 + "-" * 12)
    scores = score_vot([first, second], PLAIN)
    assert scores.accuracy == pytest.approx((0.75 * 5 + 0.25 * 15) / 20)
    assert scores.robustness == pytest.approx(0.5 * 5 / 20)
    assert scores.failures == 0.5
    # The mean length is 10 frames.
    assert scores.reliability == pytest.approx(math.exp(-30 * 0.125 / 10))


@pytest.mark.parametrize(
    ("tracks", "curve"),
    [
        (["S1h"], [0, 1, 0.75]),
        (["Sh1", "S11"], [0, 0.75, 0.875]),
        # The end is reached after 1 frame: from 2 on there is the other fragment alone.
        (["Sh", "S111"], [0, 0.75, 1, 1]),
        # Lost after 1 frame of 1: overlap 0 for ever, mean 1, 1/2, 1/3.
        (["S1X-", "S111"], [0, 1, 0.75, 2 / 3]),
        # Two fragments of one run: lost at once (0, 0, 0), then .5 and the end.
        (["SX--Sh"], [0, 0.25]),
        # As long as the longest fragment, not as the sequence.
        (["S1X--"], [0, 1]),
    ],
)
def test_expected_overlap_curve(tracks, curve):
    given = expected_overlap_curve([runs(letters) for letters in tracks])
    np.testing.assert_allclose(given, curve, atol=1e-12)


@pytest.mark.parametrize(
    ("interval", "eao"),
    [
        ((1, 1), 1),
        ((1, 3), (1 + 0.75 + 2 / 3) / 3),
        ((3, 99), 2 / 3),  # as far as the curve goes
        ((4, 99), math.nan),  # it ends before
    ],
)
def test_eao_averages_the_curve_over_the_interval(interval, eao):
    stack = VotStack("test", "test", interval)
    scores = score_vot([runs("S1X-"), runs("S111")], stack)
    assert scores.eao == pytest.approx(eao, nan_ok=True)
    np.testing.assert_allclose(scores.curve, [0, 1, 0.75, 2 / 3])


def test_frames_without_truth_do_not_count():
    truth = np.array([TRUTH, TRUTH, NAN, NAN, TRUTH], dtype=float)
    scores = score_vot([VotRuns("clip", truth, (100, 100), [track("S11qh")])], PLAIN)
    assert scores.accuracy == pytest.approx(0.75)
    np.testing.assert_allclose(scores.curve, [0, 1, 0.75])


@pytest.mark.parametrize(
    ("letters", "curve"), [("S1X-", [0, 1]), ("X---", []), ("S1X-SX", [0, 0.5])]
)
def test_a_crash_is_a_failure(letters, curve):
    # A tracker that crashes fails in that frame and is not started again.
    crashed = VotRuns(
        "clip",
        np.broadcast_to(np.array(TRUTH, dtype=float), (len(letters), 4)),
        (100, 100),
        [track(letters, failure="frame 2: update raised OSError")],
    )
    scores = score_vot([crashed], PLAIN)
    assert scores.failures == letters.count("X")
    np.testing.assert_allclose(scores.curve, curve)


def test_the_stacks_intervals():
    # Kristan et al., VOT2015 and VOT2017 results: the lengths most sequences have.
    intervals = {name: stack.interval for name, stack in STACKS.items()}
    assert intervals["vot2014"] is None
    assert intervals["vot2016"] == intervals["vot2015"] == (108, 371)
    assert intervals["vot2018"] == intervals["vot2017"] == (100, 356)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: VotRuns("clip", np.zeros((1, 4)), (9, 9), []), "'clip' has no run"),
        (lambda: VotRuns("clip", np.zeros((1, 4)), (9, 9), [track("S1")]), "1 frames.*run has 2"),
        (
            lambda: VotRuns(
                "clip", np.zeros((1, 4)), (9, 9), [track("S", failure="torn", unscored=True)]
            ),
            "could not be read: torn",
        ),
        (lambda: score_vot([], PLAIN), "no sequences"),
        (lambda: VotStack("a", "a", (9, 5)), "0 <= low <= high"),
        (lambda: VotStack("a", "a", None, repetitions=0), "repetitions 0"),
        (lambda: VotStack("a", "a", None, sensitivity=0), "sensitivity is 0"),
    ],
)
def test_what_cannot_be_scored_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Expected overlap on occluded frames, by hand


def marked(letters, marks, **more):
    """One run, with a 1 for every frame that is marked as occluded."""
    made = runs(letters, **more)
    return replace(made, occluded=np.array([mark == "1" for mark in marks]))


@pytest.mark.parametrize(
    ("sequences", "curve"),
    [
        # One fragment: its weight does not matter, unless it is 0.
        ([("S1h", "010")], [0, 1, 0.75]),
        ([("S1h", "000")], [math.nan] * 3),
        # A third of the first is marked, all of the second: weights 1/3 and 1.
        ([("S11", "100"), ("Shh", "111")], [0, 5 / 8, 5 / 8]),
        # The first ends in a failure, and goes on to the next start, which belongs to it: three of
        # eight frames; of the second, from its start on, one of three.
        ([("S1X----Shh", "0000110100")], [0, (3 / 8 + 1 / 6) / (3 / 8 + 1 / 3), None]),
        # Without marks a sequence does not count.
        ([("S11", None), ("Shh", "111")], [0, 0.5, 0.5]),
    ],
)
def test_expected_overlap_on_occluded_frames(sequences, curve):
    made = [
        runs(letters) if marks is None else marked(letters, marks) for letters, marks in sequences
    ]
    given = expected_overlap_curve(made, occluded_up_to=100)
    for value, expected in zip(given, curve, strict=True):
        assert expected is None or value == pytest.approx(expected, abs=1e-12, nan_ok=True)


def test_without_a_failure_marks_beyond_the_interval_do_not_count():
    # Up to frame 3: a third of the first, two thirds of the second.
    made = [marked("S1111", "10011"), marked("Shhhh", "11000")]
    stack = VotStack("test", "test", (1, 3), burn_in=1)
    assert score_vot(made, stack).eao_occluded == pytest.approx((1 / 3 + 2 / 3 * 0.5) / 1)
    # All frames alike.
    assert score_vot(made, stack).eao == pytest.approx(0.75)
    assert math.isnan(score_vot(made, PLAIN).eao_occluded)
    assert math.isnan(score_vot([runs("S1111")], stack).eao_occluded)
