import numpy as np
import pytest

from re3.evaluation.peers import FirstBox, TrackerInfo
from re3.evaluation.runner import run

NAN = (np.nan,) * 4
BOX = (0.0, 0.0, 2.0, 2.0)
MOVED = (1.0, 0.0, 2.0, 2.0)

FLOOR = TrackerInfo("floor", "stays", FirstBox)


class Raises(FirstBox):
    """Fails on the frame of grey level 1."""

    def update(self, frame):
        if frame[0, 0, 0] == 1:
            raise RuntimeError("no more")
        return super().update(frame)


FAILING = TrackerInfo("failing", "raises", Raises)


def test_every_tracker_runs_on_every_sequence(sequence_of):
    one = sequence_of([BOX, BOX], "one", "first")
    two = sequence_of([BOX, MOVED, MOVED], "two", "second")
    results = run([FLOOR, FAILING], [one, two])
    assert [(r.sequence.name, r.tracker) for r in results] == [
        ("one", "floor"),
        ("one", "failing"),
        ("two", "floor"),
        ("two", "failing"),
    ]
    assert [r.track.failure is None for r in results] == [True, False, True, False]
    # Boxes that are not there overlap nothing.
    assert [round(r.scores.ao, 3) for r in results] == [1.0, 0.0, 0.333, 0.0]


def test_progress_covers_the_whole_run(sequence_of):
    seen = []
    run(
        [FLOOR, FAILING],
        [sequence_of([BOX] * 2, "one"), sequence_of([BOX] * 3, "two")],
        on_progress=lambda p: seen.append((p.tracker, p.frames_before + p.frames, p.frames_total)),
    )
    assert seen[:4] == [("floor", 0, 10), ("floor", 1, 10), ("floor", 2, 10), ("failing", 2, 10)]
    assert [total for _, total, _ in seen] == sorted(total for _, total, _ in seen)
    assert ("floor", 7, 10) in seen


def test_results_are_reused_only_when_asked(tmp_path, sequence_of):
    sequence = sequence_of([BOX, MOVED], "one", "made")
    made = []

    def factory():
        made.append(1)
        return FirstBox()

    info = TrackerInfo("floor", "stays", factory)
    (first,) = run([info], [sequence], out=tmp_path)
    assert (tmp_path / "made/floor/one.txt").is_file()
    (second,) = run([info], [sequence], out=tmp_path)
    assert (len(made), second.reused) == (2, False)
    (third,) = run([info], [sequence], out=tmp_path, resume=True)
    assert (len(made), third.reused) == (2, True)
    assert third.scores == first.scores
    np.testing.assert_array_equal(third.track.boxes_xywh, second.track.boxes_xywh)
    np.testing.assert_array_equal(third.track.seconds, second.track.seconds)


def test_a_failure_is_tried_again(tmp_path, sequence_of):
    sequence = sequence_of([BOX, BOX], "one", "made")
    run([FAILING], [sequence], out=tmp_path)
    (again,) = run([FAILING], [sequence], out=tmp_path, resume=True)
    assert not again.reused
    assert again.track.failure == "frame 1: update raised RuntimeError: no more"


@pytest.mark.parametrize(
    ("trackers", "boxes", "names", "out", "resume", "told"),
    [
        ([], [BOX], ["a"], False, False, "0 trackers and 1 sequences"),
        ([FLOOR], [BOX], [], False, False, "1 trackers and 0 sequences"),
        ([FLOOR, FLOOR], [BOX], ["a"], False, False, "two trackers are called 'floor'.*NAME="),
        ([FLOOR], [BOX], ["a", "a"], False, False, "two sequences are called 'made/a'"),
        ([FLOOR], [BOX], ["a"], False, True, "resume needs the folder"),
        ([FLOOR], [NAN], ["a"], False, False, "'a' has no annotated frame"),
        ([FLOOR], [BOX], ["../a"], True, False, "do not make a path"),
        (
            [TrackerInfo("gone", "", None, "no file")],
            [BOX],
            ["a"],
            False,
            False,
            "gone is not available: no file",
        ),
    ],
)
def test_what_cannot_run_is_told_before_the_run(
    tmp_path, sequence_of, trackers, boxes, names, out, resume, told
):
    sequences = [sequence_of(boxes, name) for name in names]
    with pytest.raises(ValueError, match=told):
        run(trackers, sequences, out=tmp_path if out else None, resume=resume)
