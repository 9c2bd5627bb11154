"""The loop of `re3 track`, with a tracker that finds the first box for ever."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from re3.apps.tracking import track_video
from re3.result import Result, Status
from re3.timed_tracker import TimeSpent
from re3.video import Frame, SourceError, VideoSource, VideoWriter, open_results, open_source

BOX = (4.0, 5.0, 20.0, 10.0)


class FirstBox:
    """Finds every object where it was first; `fail` is raised at an update."""

    def __init__(self, fail=None, at=3):
        self.results, self.updates, self.fail, self.at = {}, 0, fail, at

    def add(self, frame, box_xywh, name=None):
        if box_xywh[2] <= 0:
            raise ValueError("box has no area")
        identity = len(self.results) + 1
        self.results[identity] = Result(box_xywh, 1.0, Status.TRACKED, 0, identity, name)
        return identity

    def update(self, frame):
        self.updates += 1
        if self.fail is not None and self.updates == self.at:
            raise self.fail
        status = Status.LOST if self.updates > 2 else Status.TRACKED
        self.results = {
            i: replace(r, frame_index=r.frame_index + 1, status=status)
            for i, r in self.results.items()
        }
        return self.results


class Made(VideoSource):
    """Frames made up; breaks after `frames` where `breaks`."""

    def __init__(self, frames, start=0, breaks=False, frame_count=None):
        self.name, self.fps, self.size, self.frame_count = "made", Fraction(25), (64, 48), None
        self.frame_count = frame_count
        self.frames, self.start, self.breaks = frames, start, breaks

    def __iter__(self):
        for index in range(self.start, self.start + self.frames):
            yield Frame(np.full((48, 64, 3), index, np.uint8), index, index / 25)
        if self.breaks:
            raise SourceError("made is broken")

    def close(self):
        pass


def test_every_frame_and_object_reaches_the_writers(tmp_path):
    with (
        VideoWriter(tmp_path / "v.mp4", 25, (64, 48)) as video,
        open_results(tmp_path / "r.jsonl") as results,
    ):
        seen = []
        outcome = track_video(
            Made(6, start=30),
            FirstBox(),
            {"dog": BOX, "cat": (1, 2, 3, 4)},
            video,
            results,
            on_frame=lambda frame, done: seen.append((frame.index, done.frames)),
        )
    assert seen == [(30 + i, 1 + i) for i in range(6)]
    assert (outcome.frames, outcome.updates, outcome.interrupted) == (6, 5, False)
    assert outcome.broken is None
    assert outcome.statuses == {"tracked": 6, "lost": 6}
    assert outcome.fps > 0
    assert [result.name for result in outcome.last.values()] == ["dog", "cat"]
    rows = [json.loads(line) for line in (tmp_path / "r.jsonl").read_text().splitlines()]
    assert [(row["frame"], row["object"]) for row in rows] == [
        (30 + i, name) for i in range(6) for name in ("dog", "cat")
    ]
    assert rows[2]["timestamp"] == pytest.approx(31 / 25)
    with open_source(tmp_path / "v.mp4") as source:
        assert len(list(source)) == 6


def test_times_of_crops_and_network_add_up_where_the_tracker_tells():
    class Tells(FirstBox):
        time_spent = TimeSpent(0.5, 2.0)

    outcome = track_video(Made(5), Tells(), {"dog": BOX})
    assert (outcome.crop_seconds, outcome.network_seconds) == (4 * 0.5, 4 * 2.0)
    outcome = track_video(Made(5), FirstBox(), {"dog": BOX})
    assert np.isnan([outcome.crop_seconds, outcome.network_seconds]).all()


def test_it_stops_after_as_many_frames_as_asked_for():
    tracker = FirstBox()
    outcome = track_video(Made(9), tracker, {"dog": BOX}, max_frames=4)
    assert (outcome.frames, tracker.updates, outcome.interrupted) == (4, 3, False)


def test_it_stops_between_frames_when_asked_to():
    answers = iter([False, False, True])
    outcome = track_video(Made(9), FirstBox(), {"dog": BOX}, stop=lambda: next(answers))
    assert (outcome.frames, outcome.interrupted) == (3, True)


def test_ctrl_c_in_the_tracker_keeps_the_frames_before(tmp_path):
    with open_results(tmp_path / "r.csv") as results:
        outcome = track_video(
            Made(9), FirstBox(fail=KeyboardInterrupt()), {"dog": BOX}, results=results
        )
    assert (outcome.frames, outcome.interrupted) == (3, True)
    assert len((tmp_path / "r.csv").read_text().splitlines()) == 1 + 3


def test_a_source_that_breaks_keeps_the_frames_before():
    outcome = track_video(Made(5, breaks=True), FirstBox(), {"dog": BOX})
    assert (outcome.frames, outcome.broken, outcome.interrupted) == (5, "made is broken", False)


@pytest.mark.parametrize(
    ("source", "missing"),
    [
        (Made(5, frame_count=5), 0),
        (Made(5, frame_count=12), 7),
        (Made(5, start=7, frame_count=12), 0),
        (Made(5, frame_count=4), 0),  # an estimate that is too low
        (Made(5), 0),
    ],
)
def test_frames_that_were_announced_but_not_given_are_counted(source, missing):
    assert track_video(source, FirstBox(), {"dog": BOX}).missing == missing


@pytest.mark.parametrize(
    ("source", "box", "tracker", "error"),
    [
        (Made(0, breaks=True), BOX, FirstBox(), SourceError),
        (Made(0), BOX, FirstBox(), SourceError),
        (Made(5), (0, 0, 0, 0), FirstBox(), ValueError),
        (Made(5), BOX, FirstBox(fail=ZeroDivisionError()), ZeroDivisionError),  # a bug is shown
    ],
)
def test_what_cannot_begin_or_is_a_bug_is_raised(source, box, tracker, error):
    with pytest.raises(error):
        track_video(source, tracker, {"dog": box})
