"""Shots of videos and the tracks that are kept of them."""

from dataclasses import replace
from fractions import Fraction

import cv2
import numpy as np
import pytest
import stub_trackers as stubs

from re3.data.sequence import Sequence
from re3.labelling.agreement import Pair
from re3.labelling.config import LabelConfig
from re3.labelling.regions import Region
from re3.labelling.shots import Shot, ShotReader
from re3.labelling.videos import label_given, label_shot, label_video, travelled
from re3.video import SourceError
from re3.video.writer import VideoWriter

PAIR = Pair(stubs.Bright(), stubs.Bright())


def write(path, frames, fps=15):
    with VideoWriter(path, fps, frames[0].shape[1::-1]) as video:
        for frame in frames:
            video.write(frame)
    return path


def shot(frames):
    return Shot(frames, np.arange(len(frames)), 1.0)


@pytest.mark.parametrize(
    ("fps", "config", "indices"),
    [
        (15, LabelConfig(), [range(60)]),
        (30, LabelConfig(), [range(0, 60, 2)]),  # thinned out
        (15, LabelConfig(longest=25), [range(25), range(25, 50)]),  # the last 10 are too few
        (15, LabelConfig(shortest=61, longest=61), []),
        (12, LabelConfig(fps=15), [range(60)]),
    ],
)
def test_frames_are_thinned_out_and_divided(tmp_path, fps, config, indices):
    reader = ShotReader(write(tmp_path / "a.mp4", stubs.footage(60, speed=2), fps), config)
    found = [s.indices.tolist() for s in reader.shots()]
    assert found == [list(part) for part in indices]
    assert reader.fps == Fraction(fps, reader.step)


def test_a_cut_divides(tmp_path):
    other = [255 - frame for frame in stubs.footage(30, seed=9)]
    reader = ShotReader(write(tmp_path / "a.mp4", stubs.footage(30) + other), LabelConfig())
    assert [s.indices.tolist() for s in reader.shots()] == [list(range(30)), list(range(30, 60))]


def test_frames_are_scaled_to_even_sides(tmp_path):
    large = [cv2.resize(frame, (402, 242)) for frame in stubs.footage(24)]
    (found,) = ShotReader(write(tmp_path / "a.mp4", large), LabelConfig(side=205)).shots()
    assert found.frames[0].shape == (122, 204, 3)
    assert found.scale == pytest.approx(205 / 402)


def test_a_moving_object_becomes_a_track_with_its_boxes():
    (track,) = label_shot(shot(stubs.footage()), PAIR, LabelConfig())
    np.testing.assert_allclose(track.boxes_xywh, [stubs.square(t) for t in range(40)])
    assert len(track.frames) == 40 and track.first_frame == 0 and track.agreement == 1.0


def test_boxes_of_frames_without_agreement_are_interpolated():
    class Blinks(stubs.Bright):
        def update(self, frame):
            box, score = super().update(frame)
            return (stubs.square(0) if 70 < box[0] < 78 else box), score

    # In frames 21 and 22 the second tracker is wrong, and so is the mean of the boxes there.
    pair = Pair(stubs.Bright(), Blinks())
    start = [Region(0, stubs.square(0), 1.0)]
    (track,) = label_given(shot(stubs.footage()), start, pair, LabelConfig())
    np.testing.assert_allclose(track.boxes_xywh, [stubs.square(t) for t in range(40)])
    assert label_given(shot(stubs.footage()), start, pair, LabelConfig(gap=0)) == []


def test_trackers_that_do_not_agree_leave_nothing():
    pair = Pair(stubs.Bright(), stubs.Stays())
    assert label_shot(shot(stubs.footage()), pair, LabelConfig()) == []


def test_what_hardly_moves_is_not_kept_unless_it_was_given():
    frames = stubs.footage(40, speed=0)
    wobbling = [np.roll(f, t % 2, axis=1) for t, f in enumerate(frames)]
    assert label_shot(shot(wobbling), PAIR, LabelConfig()) == []
    start = [Region(3, stubs.square(3, 0), 1.0)]
    (track,) = label_given(shot(frames), start, PAIR, LabelConfig())
    assert len(track.boxes_xywh) == 40


@pytest.mark.parametrize("changed", [{"least_side": 25.0}, {"shortest": 41}, {"least_motion": 9.0}])
def test_what_is_too_small_short_or_still_is_not_kept(changed):
    config = replace(LabelConfig(), **changed)
    assert label_shot(shot(stubs.footage()), PAIR, config) == []


def test_no_more_objects_than_asked_for():
    frames = stubs.footage()
    for t, frame in enumerate(frames):
        stubs.paint(frame, (10 + 3 * t, 65, 24, 20))
    assert len(label_shot(shot(frames), PAIR, LabelConfig())) == 2
    assert len(label_shot(shot(frames), PAIR, LabelConfig(objects=1))) == 1


def test_given_boxes_are_scaled_and_start_in_a_frame_that_is_used(tmp_path):
    frames = [cv2.resize(f, None, fx=2, fy=2) for f in stubs.footage(60, speed=1)]
    video = write(tmp_path / "a.mp4", frames, 30)
    # One box in an odd frame; the video is thinned to every second one.
    given = Sequence("a", video, 2 * stubs.square(31, 1)[None], start_frame=31)
    tracks, fps = label_video(video, PAIR, LabelConfig(side=160), [given])
    (track,) = tracks
    assert fps == 15 and track.first_frame % 2 == 1
    truth = [stubs.square(t, 1) for t in range(1, 60, 2)]
    np.testing.assert_allclose(track.boxes_xywh, truth, atol=1.5)


def test_a_broken_video_is_an_error(tmp_path):
    (tmp_path / "a.mp4").write_text("no video")
    with pytest.raises(SourceError, match=r"a\.mp4 cannot be opened"):
        label_video(tmp_path / "a.mp4", PAIR, LabelConfig())


def test_how_far_a_box_travels_is_in_units_of_its_size():
    boxes = np.array([[0.0, 0, 10, 10], [30, 40, 10, 10]])
    assert travelled(boxes) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"threshold": 0.0}, "threshold is 0.0; expected an overlap above 0, up to 1"),
        ({"threshold": 60.0}, "threshold is 60.0"),
        ({"shortest": 1}, "shortest is 1 and longest 100"),
        ({"shortest": 30, "longest": 20}, "longest not below shortest"),
        ({"gap": -1}, "gap is -1; expected 0 or more"),
        ({"objects": 0}, "objects is 0; expected 1 or more"),
        ({"side": 8}, "side is 8; expected 32 or more"),
        ({"fps": 0.0}, "fps is 0.0; expected above 0"),
        ({"fps": float("nan")}, "fps is nan; expected above 0"),
    ],
)
def test_values_out_of_range_are_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        LabelConfig(**changed)
