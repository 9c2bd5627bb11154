"""Losses and their likely causes on tracks made for the purpose."""

import numpy as np
import pytest

from re3.evaluation.failures import (
    LOSS_FRAMES,
    Cause,
    Loss,
    explain,
    find_losses,
    frame_overlaps,
)
from re3.evaluation.failures_strip import overlap_svg, strip_frames, view_of

NAN = float("nan")
FRAMES = 30
LOST_AT = 15


def still():
    """A box of 40 x 40 that stays at 100, 100 of a frame of 320 x 240."""
    return np.tile([100.0, 100.0, 40.0, 40.0], (FRAMES, 1))


def slipping(truth):
    """A tracker that is right up to the loss and creeps away from frame 12 on."""
    predicted = truth.copy()
    for frame in range(12, FRAMES):
        predicted[frame] = predicted[frame - 1] + [14.0, 0, 0, 0]
    return predicted


def cause_of(truth, predicted, **marks):
    losses = find_losses(frame_overlaps(predicted, truth))
    assert len(losses) == 1
    return losses[0], explain(losses[0], predicted, truth, **marks)


@pytest.mark.parametrize(
    ("overlaps", "expected"),
    [
        ([1.0] * 20, []),
        ([1.0] * 5 + [0.05] * (LOSS_FRAMES - 1) + [1.0], []),  # one frame short
        ([1.0] * 5 + [0.05] * LOSS_FRAMES + [1.0], [Loss(5, 15, False)]),
        ([1.0] * 5 + [0.1] * LOSS_FRAMES + [1.0], []),  # not below
        ([1.0] * 5 + [0.0] * 3, [Loss(5, 8, True)]),  # short, but to the end
        ([1.0, 0.0, NAN, NAN, 0.0], [Loss(1, 5, True)]),  # no truth does not end a loss
        ([1.0] + [0.0] * 6 + [NAN] * 9 + [0.0] * 4 + [0.5], [Loss(1, 20, False)]),
        ([1.0] + [0.0] * 6 + [NAN] * 9 + [0.5], []),  # nor does it count
        ([1.0] + [0.0] * 12 + [1.0] + [0.0], [Loss(1, 13, False), Loss(14, 15, True)]),
        ([NAN, 1.0, 0.0, NAN], [Loss(2, 3, True)]),
    ],
)
def test_losses(overlaps, expected):
    assert find_losses(overlaps) == expected


def test_overlaps_of_frames_keep_their_places():
    truth = [[NAN] * 4, [0, 0, 10, 10], [0, 0, 10, 10], [NAN] * 4, [0, 0, 10, 10]]
    predicted = [[NAN] * 4, [NAN] * 4, [5, 0, 10, 10], [0, 0, 10, 10], [NAN] * 4]
    np.testing.assert_allclose(
        frame_overlaps(predicted, truth), [NAN, 1.0, 1 / 3, NAN, 0.0], equal_nan=True
    )


def test_drift():
    truth = still()
    loss, finding = cause_of(truth, slipping(truth))
    # 14 pixels a frame from frame 12 on: 2.1 widths of a third in frame 14.
    assert (loss.start, loss.final) == (14, True)
    assert finding.cause is Cause.DRIFT


def test_a_tracker_without_box_has_stopped():
    truth = still()
    predicted = truth.copy()
    predicted[LOST_AT:] = NAN
    # That comes before everything else.
    _, finding = cause_of(truth, predicted, occluded=np.ones(FRAMES, dtype=bool))
    assert finding.cause is Cause.STOPPED
    assert finding.evidence == "no box in frame 15"


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        (3, Cause.DRIFT),  # too long ago
        (4, Cause.OCCLUSION),
        (14, Cause.OCCLUSION),
        (15, Cause.DRIFT),  # after the loss
    ],
)
def test_occlusion_within_the_window(marked, expected):
    truth = still()
    occluded = np.zeros(FRAMES, dtype=bool)
    occluded[marked] = True
    _, finding = cause_of(truth, slipping(truth), occluded=occluded)
    assert finding.cause is expected
    if expected is Cause.OCCLUSION:
        assert finding.evidence == f"marked as occluded in frame {marked}"


def test_out_of_view_without_truth():
    truth = still()
    predicted = slipping(truth)
    truth[10:13] = NAN
    _, finding = cause_of(truth, predicted, frame_size=(320, 240))
    assert finding.cause is Cause.OUT_OF_VIEW
    assert finding.evidence.startswith("no truth in frame 10")


def test_out_of_view_cut_by_the_border():
    truth = still()
    # It leaves to the left, slowly; the truth is what is still to be seen.
    truth[:, 0], truth[:, 2] = 0.0, np.linspace(60, 20, FRAMES)
    predicted = slipping(truth)
    _, finding = cause_of(truth, predicted, frame_size=(320, 240))
    assert finding.cause is Cause.OUT_OF_VIEW
    assert "at the frame's border, with" in finding.evidence
    # Without the size of the frame nobody knows of the border.
    _, finding = cause_of(truth, predicted)
    assert finding.cause is not Cause.OUT_OF_VIEW


def test_large_at_the_border_is_not_out_of_view():
    truth = still()
    truth[:, 0] = 0.0
    _, finding = cause_of(truth, slipping(truth), frame_size=(320, 240))
    assert finding.cause is Cause.DRIFT


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        ((0.0, 20.0), Cause.DRIFT),  # exactly half the height
        ((0.0, 20.5), Cause.FAST_MOTION),
        ((-25.0, 0.0), Cause.FAST_MOTION),
    ],
)
def test_fast_motion(step, expected):
    truth = still()
    predicted = slipping(truth)
    truth[14:, :2] += step
    _, finding = cause_of(truth, predicted)
    assert finding.cause is expected


def test_fast_motion_says_where():
    truth = still()
    predicted = truth.copy()
    truth[LOST_AT:, 0] += 60
    _, finding = cause_of(truth, predicted)
    assert finding.evidence == "centre moved 1.50 of the width from frame 14 to 15"


@pytest.mark.parametrize(
    ("growth", "expected"),
    [
        ((1.6, 1.6), Cause.SCALE_CHANGE),
        ((0.6, 0.6), Cause.SCALE_CHANGE),
        ((1.4, 1.4), Cause.DRIFT),
        ((1.3, 0.8), Cause.ASPECT_CHANGE),  # the area is nearly the same
        ((1.2, 0.9), Cause.DRIFT),
    ],
)
def test_changes_of_size(growth, expected):
    truth = still()
    predicted = truth.copy()
    change = np.clip((np.arange(FRAMES) - 8) / 5, 0, 1)[:, None]
    size = 40 * (1 + change * (np.array(growth) - 1))
    truth[:, :2], truth[:, 2:] = 120 - size / 2, size
    # The tracker follows until frame 14 and then creeps off to the right.
    predicted[:LOST_AT] = truth[:LOST_AT]
    for frame in range(LOST_AT, FRAMES):
        predicted[frame] = predicted[frame - 1] + [0.45 * predicted[0, 2], 0, 0, 0]
    loss, finding = cause_of(truth, predicted)
    assert loss.start < 20
    assert finding.cause is expected


def test_a_tracker_that_jumps_off_has_met_a_distractor():
    truth = still()
    predicted = truth.copy()
    predicted[LOST_AT:, 0] += 60
    _, finding = cause_of(truth, predicted)
    assert finding.cause is Cause.DISTRACTOR
    assert "jumped by 1.50 of its size from frame 14 to 15" in finding.evidence


def test_the_start_is_no_jump():
    """Frames before the first annotated one have neither truth nor box."""
    truth = still()[:8]
    truth[:2] = NAN
    predicted = truth.copy()
    for frame in range(3, 8):
        predicted[frame] = predicted[frame - 1] + [18.0, 0, 0, 0]
    _, finding = cause_of(truth, predicted)
    assert finding.cause is Cause.DRIFT


@pytest.mark.parametrize(
    ("start", "length", "expected"),
    [
        (50, 100, [40, 45, 50, 55, 60]),
        (1, 100, [0, 1, 4, 8, 11]),  # only one frame before
        (99, 100, [89, 92, 94, 96, 99]),
        (0, 1, [0]),
        (1, 3, [0, 1, 2]),
    ],
)
def test_frames_of_a_strip(start, length, expected):
    frames = strip_frames(start, length)
    assert frames == expected
    assert start in frames


def test_a_view_holds_the_boxes_and_keeps_the_shape_of_the_frame():
    boxes = np.array([[600, 30, 20, 20], [650, 60, 20, 20], [NAN] * 4])
    left, top, right, bottom = view_of(boxes, 1280, 720)
    assert 0 <= left <= 600 and 0 <= top <= 30 and right >= 670 and bottom >= 80
    assert (right - left) / (bottom - top) == pytest.approx(1280 / 720, rel=0.02)
    assert right - left < 640
    # Boxes over most of the frame, or none at all: the whole frame.
    assert view_of(np.array([[0, 0, 900, 700.0]]), 1280, 720) == (0, 0, 1280, 720)
    assert view_of(np.full((2, 4), NAN), 1280, 720) == (0, 0, 1280, 720)


def test_the_overlap_curve_has_gaps_and_marks():
    svg = overlap_svg(np.array([1.0, 0.5, NAN, NAN, 0.0, 0.0]), [(4, 6)])
    assert svg.count("<polyline") == 2
    assert svg.count("<rect") == 1
    assert 'points="1.0,2.0 64.6,32.0"' in svg
