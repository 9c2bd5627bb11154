from pathlib import Path

import numpy as np
import pytest

from re3.evaluation.floors import FirstBox, RandomWalk
from re3.evaluation.peers import TrackerInfo
from re3.evaluation.runner import run
from re3.evaluation.supervised import SupervisedConfig

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
    assert seen[:5] == [
        ("floor", 0, 10),
        ("floor", 1, 10),
        ("floor", 2, 10),
        ("floor", 2, 10),  # ended
        ("failing", 2, 10),
    ]
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


def test_what_a_killed_run_left_beside_a_finished_result_goes(tmp_path, sequence_of):
    sequence = sequence_of([BOX, MOVED], "one", "made")
    run([FLOOR], [sequence], out=tmp_path)
    folder = tmp_path / "made/floor"
    left = [folder / f".one.txt.4711.{kind}" for kind in ("journal", "partial")]
    others = folder / ".two.txt.4711.journal"
    for path in (*left, others):
        path.write_text("")
    (result,) = run([FLOOR], [sequence], out=tmp_path, resume=True)
    assert result.reused
    assert not any(path.exists() for path in left) and others.exists()


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


def test_a_sequence_without_truth_fails_and_the_rest_goes_on(tmp_path, sequence_of):
    empty, good = sequence_of([NAN, NAN], "empty"), sequence_of([BOX, BOX], "good")
    for _ in range(2):  # alone, and taking over results
        failed, fine = run([FLOOR], [empty, good], out=tmp_path, resume=True)
        assert failed.track.failure == "no frame is annotated, so there is none to start at"
        assert failed.track.unscored and np.isnan(failed.scores.auc)
        assert fine.track.failure is None and fine.scores.ao == 1.0
    assert fine.reused
    assert not (tmp_path / "made/floor/empty.txt").exists()


def test_frames_that_cannot_be_read_are_not_the_trackers_fault(sequence_of):
    class Broken(type(sequence_of([BOX]))):
        def frames(self):
            yield next(super().frames())
            raise ValueError("frame 1 is broken")

    broken = Broken("broken", Path("broken.mp4"), np.array([BOX, BOX, BOX]), dataset="made")
    failed, fine = run([FLOOR], [broken, sequence_of([BOX, BOX], "good")])
    assert failed.track.failure == "frame 1: cannot be read: ValueError: frame 1 is broken"
    assert failed.track.boxes_xywh[0].tolist() == list(BOX)
    assert np.isnan(failed.scores.auc) and fine.scores.ao == 1.0


def test_a_tracker_that_cannot_be_made_misses_everything(sequence_of):
    def factory():
        raise FileNotFoundError("no weights")

    (result,) = run([TrackerInfo("x", "", factory)], [sequence_of([BOX, BOX])])
    assert result.track.failure == (
        "frame 0: the tracker cannot be made: FileNotFoundError: no weights"
    )
    assert (result.track.unscored, result.scores.ao) == (False, 0.0)


def test_repetitions_of_a_tracker_that_draws_numbers(tmp_path, sequence_of):
    sequence = sequence_of([BOX] * 5)
    walk = TrackerInfo("walk", "", RandomWalk, seeded=True)
    results = run([walk, FLOOR], [sequence], out=tmp_path, repeats=2)
    assert [(r.tracker, r.repeat) for r in results] == [
        ("walk", 0),
        ("walk", 1),
        ("floor", 0),
        ("floor", 1),
    ]
    first, second = (r.track.boxes_xywh for r in results[:2])
    assert not np.array_equal(first, second)
    assert {p.name for p in (tmp_path / "made/walk").glob("*.txt")} == {
        "clip.txt",
        "clip.repeat-2.txt",
    }
    again = run([walk], [sequence], out=tmp_path, repeats=2, resume=True)
    assert [r.reused for r in again] == [True, True]
    np.testing.assert_array_equal(again[1].track.boxes_xywh, second)


def test_published_boxes_are_shown_without_running(tmp_path, sequence_of):
    (tmp_path / "one.txt").write_text("9,9,9,9\n1,0,2,2\n")
    (tmp_path / "long.txt").write_text("0,0,2,2\n" * 3)
    info = TrackerInfo("theirs", "", None, published=tmp_path)
    sequences = [sequence_of([BOX, MOVED], name) for name in ("one", "long", "gone")]
    one, long, gone = run([info], sequences)
    # The first frame is the truth, whatever they wrote there.
    assert one.track.boxes_xywh.tolist() == [list(BOX), list(MOVED)]
    assert (one.scores.ao, one.reused, one.track.update_seconds.size) == (1.0, False, 0)
    assert "has 3 boxes for 2 frames" in long.track.failure
    assert "gone.txt does not exist" in gone.track.failure
    assert np.isnan([long.scores.auc, gone.scores.auc]).all()
    with pytest.raises(ValueError, match="theirs is published boxes of one pass"):
        run([info], sequences, supervised=SupervisedConfig())


def test_runs_with_restarts_are_kept_and_taken_over(tmp_path, sequence_of):
    far = (50.0, 50.0, 2.0, 2.0)
    sequence = sequence_of([NAN, BOX, far, BOX, BOX, BOX])
    config = SupervisedConfig(restart_after=2)
    (first,) = run([FLOOR], [sequence], out=tmp_path, supervised=config)
    text = (tmp_path / "made/floor/clip.txt").read_text().splitlines()
    assert text == ["0", "1", "2", "0", "1", "0,0,2,2"]
    (second,) = run([FLOOR], [sequence], out=tmp_path, supervised=config, resume=True)
    assert second.reused and np.isnan(second.scores.auc)
    for name in ("boxes_xywh", "steps", "seconds", "scores", "decode_seconds"):
        np.testing.assert_array_equal(
            getattr(first.supervised, name), getattr(second.supervised, name)
        )
