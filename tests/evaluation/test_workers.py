"""Trackers in processes of their own."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import fake_trackers as fakes
import numpy as np
import pytest

from re3.data.plain import read_folder
from re3.evaluation.peers import TrackerInfo
from re3.evaluation.runner import run
from re3.evaluation.supervised import Step, SupervisedConfig

FRAMES = 6


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder `made` with six clips of six frames of 32 x 24 pixels."""
    random = np.random.default_rng(0)
    for name in "abcdef":
        pictures = tmp_path / "made" / name
        pictures.mkdir(parents=True)
        for index in range(FRAMES):
            image = random.integers(0, 255, (24, 32, 3)).astype(np.uint8)
            cv2.imwrite(str(pictures / f"{index}.png"), image)
        (tmp_path / "made" / f"{name}.txt").write_text("4,4,8,8\n" * FRAMES)
    return tmp_path / "made"


def info(kind) -> TrackerInfo:
    return TrackerInfo(kind.__name__, "", kind)


def test_the_boxes_do_not_depend_on_the_number_of_jobs(folder, tmp_path):
    sequences = read_folder(folder)[:3]
    trackers = [info(fakes.Follows), info(fakes.Draws)]
    seen = []
    one = run(trackers, sequences, jobs=1, on_progress=seen.append)
    two = run(trackers, sequences, jobs=2, out=tmp_path / "out")
    for a, b in zip(one, two, strict=True):
        assert (a.tracker, a.sequence.name) == (b.tracker, b.sequence.name)
        np.testing.assert_array_equal(a.track.boxes_xywh, b.track.boxes_xywh)
        assert a.scores == b.scores
        assert np.isfinite(a.track.seconds).all() and np.isfinite(a.track.decode_seconds).all()
    (here,) = run(trackers[:1], sequences[:1])
    np.testing.assert_array_equal(here.track.boxes_xywh, one[0].track.boxes_xywh)
    assert sum(progress.ended for progress in seen) == 6
    assert seen[-1].frames_before + seen[-1].frames == seen[-1].frames_total == 6 * FRAMES
    # Nothing but whole files is left.
    assert {path.suffix for path in (tmp_path / "out").rglob("*") if path.is_file()} == {
        ".txt",
        ".csv",
    }


@pytest.mark.parametrize(
    ("kind", "known", "told"),
    [
        (fakes.Raises, 3, "frame 3: update raised RuntimeError: no more"),
        (fakes.Garbage, 3, "frame 3: update gave"),
        (fakes.Crashes, 3, "frame 3: the tracker's process died (exit code 7)"),
        (fakes.Hangs, 3, "frame 3: no answer within 1 seconds; the tracker was stopped"),
        (fakes.HangsAtStart, 0, "frame 0: no answer within 1 seconds; the tracker was stopped"),
    ],
)
def test_what_goes_wrong_is_told_and_the_rest_goes_on(folder, kind, known, told):
    failed, fine = run(
        [info(kind), info(fakes.Follows)], read_folder(folder)[:1], jobs=1, timeout=1.0
    )
    assert failed.track.failure is not None and failed.track.failure.startswith(told)
    assert np.isfinite(failed.track.boxes_xywh[:, 0]).sum() == known
    # What it gave before is what it would have given.
    np.testing.assert_array_equal(failed.track.boxes_xywh[:known], fine.track.boxes_xywh[:known])
    assert not failed.track.unscored
    assert fine.track.failure is None


def test_a_tracker_that_hangs_has_failed_in_a_run_with_restarts_too(folder):
    (result,) = run(
        [info(fakes.Hangs)],
        read_folder(folder)[:1],
        jobs=1,
        timeout=1.0,
        supervised=SupervisedConfig(),
    )
    assert result.supervised.steps.tolist() == [
        Step.STARTED,
        Step.FOLLOWED,
        Step.FOLLOWED,
        Step.FAILED,
        Step.SKIPPED,
        Step.SKIPPED,
    ]
    assert result.supervised.failure.startswith("frame 3: no answer")


def test_missing_frames_fail_the_sequence_alone(folder):
    (folder / "a" / "4.png").unlink()
    (folder / "b" / "2.png").write_bytes(b"no picture")
    short, broken, fine = run([info(fakes.Follows)], read_folder(folder)[:3], jobs=2)
    assert short.track.failure.startswith("frame 5: cannot be read: ")
    assert broken.track.failure.startswith("frame 2: cannot be read: ")
    assert np.isnan([short.scores.auc, broken.scores.auc]).all()
    assert fine.track.failure is None and fine.scores.auc > 0


def test_a_factory_that_cannot_be_sent_is_refused(folder):
    with pytest.raises(ValueError, match=r"'a' cannot be sent to a worker.*jobs=0"):
        run([TrackerInfo("local", "", lambda: fakes.Follows())], read_folder(folder)[:1], jobs=1)


@pytest.mark.parametrize(("jobs", "timeout"), [(-1, 1.0), (1, 0.0), (1, float("nan"))])
def test_limits_have_to_make_sense(folder, jobs, timeout):
    with pytest.raises(ValueError, match="expected"):
        run([info(fakes.Follows)], read_folder(folder)[:1], jobs=jobs, timeout=timeout)


def test_a_run_that_was_killed_goes_on_where_it_was(folder, tmp_path):
    here, out, log = Path(__file__).parent, tmp_path / "out", tmp_path / "log"
    environment = {
        **os.environ,
        "SLOW_LOG": str(log),
        "PYTHONPATH": os.pathsep.join(filter(None, [*sys.path, str(here)])),
    }
    command = [sys.executable, "-m", "re3", "eval", str(folder), "-t", "python:fake_trackers:Slow"]
    resumable = [*command, "--out", str(out), "--jobs", "2"]
    with subprocess.Popen(resumable, env=environment, stdout=subprocess.DEVNULL) as first:
        _wait_for(lambda: len(list(out.rglob("*.txt"))) >= 2)
        first.send_signal(signal.SIGKILL)
    assert first.returncode == -signal.SIGKILL
    workers = {int(pid) for pid in log.read_text().split()}
    # They do not go on by themselves.
    _wait_for(lambda: not any(_runs(pid) for pid in workers))
    finished = list(out.rglob("*.txt"))
    assert 2 <= len(finished) < 6
    assert all(len(path.read_text().splitlines()) == FRAMES for path in finished)
    starts = len(log.read_text().split())
    assert starts <= len(finished) + 2

    second = subprocess.run([*resumable, "--resume"], env=environment, stdout=subprocess.DEVNULL)
    assert second.returncode == 0
    # Six clips, and at most one more for each of the two jobs.
    assert len(log.read_text().split()) - starts == 6 - len(finished)
    assert not list(out.rglob(".*"))
    subprocess.run(
        [*command, "--out", str(tmp_path / "whole")],
        env=environment,
        stdout=subprocess.DEVNULL,
        check=True,
    )
    for name in "abcdef":
        files = [place / "made" / "Slow" / f"{name}.txt" for place in (out, tmp_path / "whole")]
        assert files[0].read_text() == files[1].read_text()


def _wait_for(holds, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def _runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"
