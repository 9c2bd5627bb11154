import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from re3.evaluation import metrics
from re3.evaluation.metrics import Scores, score

NAN = (np.nan,) * 4
TRUTH = (10.0, 10.0, 20.0, 10.0)

tracks = st.integers(1, 12).flatmap(
    lambda length: st.tuples(
        arrays(np.float64, (length, 2), elements=st.floats(-200, 200)),
        arrays(np.float64, (length, 2), elements=st.floats(1, 100)),
    ).map(lambda parts: np.concatenate(parts, axis=1))
)


@pytest.mark.parametrize(
    ("overlap", "auc"),
    [
        (0.0, 0 / 21),  # not even above the threshold 0
        (0.01, 1 / 21),  # above 0 alone
        (0.05, 1 / 21),  # a threshold itself is not above it
        (0.051, 2 / 21),
        (0.5, 10 / 21),
        (0.501, 11 / 21),
        (1.0, 20 / 21),  # nothing is above 1
    ],
)
def test_success_counts_overlaps_above_the_threshold(overlap, auc):
    assert metrics.success_curve([overlap]).shape == (21,)
    assert metrics.success_curve([overlap]).mean() == pytest.approx(auc)


@pytest.mark.parametrize(
    ("distance", "first"),
    [
        (0.0, 0),
        (0.5, 1),
        (20.0, 20),  # a threshold itself is within it
        (20.001, 21),
        (50.0, 50),
        (51.0, 51),  # never
        (np.inf, 51),  # no box
    ],
)
def test_precision_counts_distances_up_to_the_threshold(distance, first):
    curve = metrics.precision_curve([distance])
    assert curve.tolist() == [0.0] * first + [1.0] * (51 - first)


@pytest.mark.parametrize(
    ("box", "distance", "normalised"),
    [
        (TRUTH, 0.0, 0.0),
        ((13, 14, 20, 10), 5.0, np.hypot(3 / 20, 4 / 10)),  # shifted by 3, 4
        ((5, 5, 30, 20), 0.0, 0.0),  # larger about the same centre
        ((10, 10, 26, 18), 5.0, np.hypot(3 / 20, 4 / 10)),  # the corner stays, the centre moves
        (NAN, np.inf, np.inf),  # no box
    ],
)
def test_distances(box, distance, normalised):
    assert metrics.centre_distance([box], [TRUTH])[0] == pytest.approx(distance)
    assert metrics.normalised_distance([box], [TRUTH])[0] == pytest.approx(normalised)


FAR = (500.0, 500.0, 20.0, 10.0)
HALF = (10.0, 10.0, 10.0, 10.0)  # overlap 0.5, centre 5 pixels off
MOST = (10.0, 10.0, 16.0, 10.0)  # overlap 0.8, centre 2 pixels off


@pytest.mark.parametrize(
    ("predicted", "truth", "expected"),
    [
        # auc, precision, normalised_precision, ao, sr50, sr75
        ([FAR], [TRUTH], (20 / 21, 1, 1, np.nan, np.nan, np.nan)),  # the first frame is given
        ([NAN], [TRUTH], (20 / 21, 1, 1, np.nan, np.nan, np.nan)),
        ([TRUTH, FAR], [TRUTH] * 2, (10 / 21, 0.5, 0.5, 0, 0, 0)),  # lost at once
        ([TRUTH, NAN], [TRUTH] * 2, (10 / 21, 0.5, 0.5, 0, 0, 0)),  # no box is as bad as lost
        ([TRUTH, HALF], [TRUTH] * 2, (15 / 21, 1, (1 + 26 / 51) / 2, 0.5, 0, 0)),
        ([TRUTH, MOST], [TRUTH] * 2, (18 / 21, 1, (1 + 41 / 51) / 2, 0.8, 1, 1)),
        ([TRUTH, FAR, MOST], [TRUTH, NAN, TRUTH], (18 / 21, 1, (1 + 41 / 51) / 2, 0.8, 1, 1)),
        ([FAR, FAR, MOST], [NAN, TRUTH, TRUTH], (18 / 21, 1, (1 + 41 / 51) / 2, 0.8, 1, 1)),
    ],
)
def test_score(predicted, truth, expected):
    scores = score(predicted, truth)
    figures = (
        scores.auc,
        scores.precision,
        scores.normalised_precision,
        scores.ao,
        scores.sr50,
        scores.sr75,
    )
    np.testing.assert_allclose(figures, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("predicted", "truth", "told"),
    [
        ([TRUTH], [TRUTH] * 2, r"\(1, 4\).*\(2, 4\)"),  # another clip
        (TRUTH, TRUTH, r"\(4,\)"),  # a box, not a track
        ([TRUTH[:3]], [TRUTH[:3]], r"\(1, 3\)"),
        ([TRUTH], [NAN], "no frame has a true box"),
        (np.empty((0, 4)), np.empty((0, 4)), "no frame has a true box"),
    ],
)
def test_what_cannot_be_scored_is_told(predicted, truth, told):
    with pytest.raises(ValueError, match=told):
        score(predicted, truth)


def test_mean_leaves_out_what_is_undefined():
    one = Scores(0.2, 0.4, 0.6, np.nan, np.nan, np.nan, 0.5, 1.0)
    two = Scores(0.4, 0.8, 0.8, 0.5, 1.0, np.nan, np.nan, 0.0)
    mean = Scores.mean([one, two])
    assert mean.auc == pytest.approx(0.3)
    assert mean.precision == pytest.approx(0.6)
    assert (mean.ao, mean.sr50) == (0.5, 1.0)
    assert np.isnan(mean.sr75)
    assert (mean.lost, mean.ends_lost) == (0.5, 0.5)


@given(tracks)
def test_the_truth_scores_the_most_there_is(truth):
    scores = score(truth, truth)
    assert scores.auc == pytest.approx(20 / 21)
    assert scores.precision == scores.normalised_precision == 1.0


@given(tracks, st.randoms())
def test_curves_are_shares_and_monotone(truth, random):
    predicted = truth.copy()
    random.shuffle(predicted)
    success = metrics.success_curve(metrics.overlap(predicted, truth))
    precision = metrics.precision_curve(metrics.centre_distance(predicted, truth))
    normalised = metrics.normalised_precision_curve(metrics.normalised_distance(predicted, truth))
    assert (np.diff(success) <= 0).all()
    assert (np.diff(precision) >= 0).all() and (np.diff(normalised) >= 0).all()
    for curve in (success, precision, normalised):
        assert (curve >= 0).all() and (curve <= 1).all()


@given(tracks, st.lists(st.integers(0, 12), max_size=4))
def test_frames_without_truth_change_nothing(truth, places):
    predicted = np.roll(truth, 1, axis=0)
    places = [min(place, len(truth)) for place in places]
    with_gaps = np.insert(truth, places, np.nan, axis=0)
    wild = np.insert(predicted, places, (1e9, 0, 1, 1), axis=0)
    assert repr(score(wild, with_gaps)) == repr(score(predicted, truth))


@pytest.mark.parametrize(
    ("shifts", "lost", "ends_lost"),
    [
        ([0, 0, 0], 0.0, 0.0),
        ([99, 0, 0], 0.0, 0.0),  # the first frame is given
        ([0, 99, 0], 0.5, 0.0),  # lost and found again
        ([0, 0, 99], 0.5, 1.0),
        ([0, 6, 99], 0.5, 1.0),  # an overlap of .25 has the object
        ([0, 7, 99], 1.0, 1.0),  # one of 3 / 17 has not
        ([0, 0, np.nan], 0.5, 1.0),  # no box
        ([0], np.nan, np.nan),
    ],
)
def test_frames_lost_and_tracks_that_end_lost(shifts, lost, ends_lost):
    truth = np.array([[10.0, 10, 10, 10]] * len(shifts))
    predicted = truth + np.array([[shift, 0, 0, 0] for shift in shifts])
    scores = score(predicted, truth)
    assert (scores.lost, scores.ends_lost) == pytest.approx((lost, ends_lost), nan_ok=True)


def test_a_track_ends_lost_by_its_last_frame_with_truth():
    truth = np.array([[10.0, 10, 10, 10], [10, 10, 10, 10], [np.nan] * 4])
    assert score(truth, truth).ends_lost == 0.0
