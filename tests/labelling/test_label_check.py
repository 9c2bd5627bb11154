"""How accurate kept boxes are, on drawn clips with known boxes."""

import numpy as np
import pytest
import stub_trackers as stubs

from re3.data.sequence import Sequence
from re3.labelling.agreement import Agreement, Pair
from re3.labelling.check import CheckedStretch, accuracy, follow_annotated
from re3.labelling.config import LabelConfig
from re3.video.writer import VideoWriter

CONFIG = LabelConfig(shortest=4, gap=0)


def stretch(overlaps, ratios, absent=()):
    """Boxes `ratios` times as wide as the truth, which is their overlap with it."""
    truth = np.tile([0.0, 0, 10, 10], (len(overlaps), 1))
    boxes = truth * np.array(ratios)[:, None] ** np.array([0, 0, 1, 0])
    truth[list(absent)] = np.nan
    return CheckedStretch(Agreement(boxes, np.array(overlaps)), truth, 0)


def test_only_what_a_threshold_keeps_counts_and_not_the_start():
    checked = [stretch([1.0, 0.9, 0.9, 0.9, 0.5, 0.5, 0.5], [1.0, 0.8, 0.8, 0.6, 0.4, 0.4, 0.4])]
    strict = accuracy(checked, 0.8, CONFIG)
    assert (strict.tracks, strict.frames, strict.kept) == (1, 3, 0.5)
    assert (strict.above_half, strict.above_seven_tenths) == (1.0, pytest.approx(2 / 3))
    assert strict.mean_overlap == pytest.approx((0.8 + 0.8 + 0.6) / 3)
    loose = accuracy(checked, 0.5, CONFIG)
    assert (loose.kept, loose.above_half) == (1.0, 0.5)


def test_a_box_where_the_object_is_absent_is_wrong():
    found = accuracy([stretch([1.0] * 5, [1.0] * 5, absent=[3])], 0.6, CONFIG)
    assert (found.frames, found.above_half) == (4, 0.75)


def test_without_a_threshold_frames_that_were_not_reached_are_not_kept():
    checked = stretch([1.0] * 4 + [0.0] * 4, [1.0] * 8)
    checked.agreement.boxes_xywh[4:] = np.nan
    assert accuracy([checked], 0.0, CONFIG).kept == pytest.approx(3 / 7)


def test_nothing_kept_has_no_accuracy():
    found = accuracy([stretch([0.1] * 8, [1.0] * 8)], 0.6, CONFIG)
    assert found.kept == 0 and np.isnan(found.mean_overlap)


def test_clips_are_followed_from_the_middle_in_pixels_of_the_scaled_frames(tmp_path):
    path = tmp_path / "a.mp4"
    with VideoWriter(path, 30, (160, 96)) as video:
        for frame in stubs.footage(40):
            video.write(frame)
    # The annotation begins in frame 4 and ends in frame 33.
    truth = np.array([stubs.square(t) for t in range(4, 34)])
    sequence = Sequence("a", path, truth, start_frame=4)
    config = LabelConfig(side=80, shortest=10)
    (checked,) = follow_annotated([sequence], Pair(stubs.Bright(), stubs.Bright()), config)
    np.testing.assert_allclose(checked.truth_xywh, truth[::2] / 2)
    assert checked.start == 7
    found = accuracy([checked], 0.6, config)
    assert found.frames == 14 and found.mean_overlap > 0.8
