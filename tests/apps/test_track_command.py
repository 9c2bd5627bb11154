"""`re3 track` on recordings that are not as they should be, and where it is ended from outside."""

import csv
import json
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.video import VideoWriter, open_source

CLIP = Path(__file__).parents[2] / "examples" / "clips" / "person.mp4"
BOX = "368,58,158,374"


def track(*arguments):
    return CliRunner().invoke(app, ["track", *(str(argument) for argument in arguments)])


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def said(result):
    return " ".join(result.output.split())


@pytest.fixture
def long_clip(tmp_path):
    path = tmp_path / "long.mp4"
    with VideoWriter(path, 25, (320, 240)) as writer:
        for index in range(1500):
            writer.write(np.full((240, 320, 3), index % 250, np.uint8))
    return path


@pytest.fixture
def noisy_clip(tmp_path):
    path = tmp_path / "noise.mp4"
    random = np.random.default_rng(0)
    with VideoWriter(path, 25, (64, 48)) as writer:
        for _ in range(12):
            writer.write(random.integers(0, 255, (48, 64, 3), np.uint8))
    return path


def running(long_clip, *arguments, **options):
    folder = long_clip.parent
    command = ["track", long_clip, "--box", "50,50,80,80", *arguments]
    process = subprocess.Popen([sys.executable, "-m", "re3", *command], **options)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        # Long enough for the encoder to have given some frames.
        if (folder / "b.csv").exists() and len((folder / "b.csv").read_text().splitlines()) > 25:
            return process
        time.sleep(0.05)
    raise AssertionError("it did not start")


def test_ctrl_c_finishes_the_files_and_says_how_many_frames(tmp_path, long_clip):
    out, boxes = tmp_path / "o.mp4", tmp_path / "b.csv"
    process = running(
        long_clip, "--out", out, "--results", boxes, stderr=subprocess.PIPE, text=True
    )
    os.kill(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    with open_source(out) as source:
        frames = len(list(source))
    assert 0 < frames < 1500
    assert len(rows(boxes)) == frames
    assert f"stopped by Ctrl-C after {frames} frames" in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.csv", "long.mp4", "o.mp4"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_killed_run_leaves_its_results_under_their_names(tmp_path, long_clip):
    out, boxes = tmp_path / "o.mp4", tmp_path / "b.csv"
    process = running(long_clip, "--out", out, "--results", boxes, stderr=subprocess.DEVNULL)
    process.kill()
    assert process.wait(timeout=60) == -signal.SIGKILL
    assert boxes.read_text().endswith("\n")
    table = rows(boxes)
    assert [int(row["frame"]) for row in table] == list(range(len(table)))
    assert all(row["status"] for row in table)
    with open_source(out) as source:
        frames = len(list(source))
    assert 0 < frames <= len(table)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.csv", "long.mp4", "o.mp4"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGHUP")
def test_a_closed_terminal_ends_it_like_ctrl_c(tmp_path, long_clip):
    pty = pytest.importorskip("pty")
    out, boxes = tmp_path / "o.mp4", tmp_path / "b.csv"
    command = [sys.executable, "-m", "re3", "track", str(long_clip), "--box", "50,50,80,80"]
    command += ["--out", str(out), "--results", str(boxes)]
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(command[0], command)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if select.select([terminal], [], [], 0.05)[0]:
            os.read(terminal, 10_000)  # what it says has to go somewhere
        if boxes.exists() and len(boxes.read_text().splitlines()) > 5:
            break
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 129
    with open_source(out) as source:
        assert len(list(source)) == len(rows(boxes)) < 1500
    assert b"moof" not in out.read_bytes()  # completed
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.csv", "long.mp4", "o.mp4"]


def break_packets(path, *numbers, half=False):
    import av

    with av.open(str(path)) as container:
        found = [(p.pos, p.size) for p in container.demux(video=0) if p.size]
    data = bytearray(path.read_bytes())
    for position, size in (found[number] for number in numbers):
        first = size // 2 if half else 4
        data[position + first : position + size] = bytes(size - first)
    path.write_bytes(data)


def test_skipped_packets_are_counted(tmp_path, noisy_clip):
    break_packets(noisy_clip, 4, 7)
    result = track(noisy_clip, "--box", "10,10,20,20", "--results", tmp_path / "b.csv")
    assert result.exit_code == 0, result.output
    assert "note: 2 packets were skipped that cannot be decoded" in said(result)
    assert [int(row["frame"]) for row in rows(tmp_path / "b.csv")] == list(range(10))


def test_damaged_frames_are_in_the_summary_and_the_results(tmp_path, noisy_clip):
    break_packets(noisy_clip, 5, half=True)
    with open_source(noisy_clip) as source:
        damaged = [frame.index for frame in source if frame.damaged]
    assert len(damaged) == 1
    for name in ("b.csv", "b.jsonl"):
        result = track(noisy_clip, "--box", "10,10,20,20", "--results", tmp_path / name)
        assert result.exit_code == 0, result.output
        assert f"1 frame is damaged, as the decoder says ({damaged[0]})" in said(result)
    marked = [int(row["frame"]) for row in rows(tmp_path / "b.csv") if row["damaged"] == "1"]
    assert marked == damaged
    lines = [json.loads(line) for line in (tmp_path / "b.jsonl").read_text().splitlines()]
    assert [line["frame"] for line in lines if line.get("damaged")] == damaged


def test_images_have_their_names_and_sizes_in_the_results(tmp_path):
    folder = tmp_path / "shots"
    folder.mkdir()
    with open_source(CLIP) as source:
        for index, frame in zip((1, 2, 5), source, strict=False):
            image = cv2.resize(frame.image, None, fx=0.5, fy=0.5) if index == 5 else frame.image
            cv2.imwrite(str(folder / f"shot_{index}.png"), image)
    names = ["shot_1.png", "shot_2.png", "shot_5.png"]
    for ending in ("coco.json", "csv", "json", "jsonl"):
        result = track(folder, "--box", BOX, "--results", tmp_path / f"b.{ending}")
        assert result.exit_code == 0, result.output
        assert "note: shots: 2 numbers are missing among its images (3 to 4)" in said(result)
    images = json.loads((tmp_path / "b.coco.json").read_text())["images"]
    assert [image["file_name"] for image in images] == names
    assert [(image["width"], image["height"]) for image in images] == [
        (768, 432),
        (768, 432),
        (384, 216),
    ]
    assert [row["image"] for row in rows(tmp_path / "b.csv")] == names
    assert [row["image"] for row in json.loads((tmp_path / "b.json").read_text())] == names


def test_frames_keep_their_times_in_the_video(tmp_path, noisy_clip):
    times = [0.0, 0.04, 0.5, 1.0, 3.0]
    clip = tmp_path / "vfr.mp4"
    with VideoWriter(clip, 25, (64, 48)) as writer, open_source(noisy_clip) as source:
        for shown, frame in zip(times, source, strict=False):
            writer.write(frame.image, shown)
    out = tmp_path / "o.mp4"
    assert track(clip, "--box", "10,10,20,20", "--out", out).exit_code == 0
    with open_source(out) as source:
        np.testing.assert_allclose([frame.timestamp for frame in source], times, atol=2e-3)


def test_frames_wider_than_h264_are_refused_before_anything_is_written(tmp_path):
    cv2.imwrite(str(tmp_path / "wide.png"), np.zeros((16, 16400, 3), np.uint8))
    result = track(tmp_path / "wide.png", "--box", "10,2,8,8", "--out", tmp_path / "o.mp4")
    assert result.exit_code == 2
    assert "16400 x 16 pixels; H.264 is written up to 16384 a side" in said(result)
    assert not (tmp_path / "o.mp4").exists()


@pytest.mark.parametrize(
    ("options", "frames"),
    [
        (["--end-frame", "3"], [0, 1, 2, 3]),
        (["--start-frame", "5", "--end-frame", "5"], [5]),
        (["--start-frame", "5", "--end-frame", "9", "--max-frames", "2"], [5, 6]),
        (["--start-frame", "5", "--end-frame", "6", "--max-frames", "9"], [5, 6]),
        (["--start-frame", "118", "--end-frame", "900"], [118, 119]),
    ],
)
def test_the_last_frame_can_be_given(tmp_path, options, frames):
    result = track(CLIP, "--box", BOX, *options, "--results", tmp_path / "b.csv")
    assert result.exit_code == 0, result.output
    assert [int(row["frame"]) for row in rows(tmp_path / "b.csv")] == frames


def test_threads_and_search_reach_the_tracker(monkeypatch):
    given = {}

    def tracker(model, engine, **options):
        given.update(options)
        raise ValueError("seen")

    monkeypatch.setattr("re3.apps.track.TimedMultiTracker", tracker)
    track(CLIP, "--box", BOX, "--threads", 2, "--no-search")
    assert (given["threads"], given["search"]) == (2, False)
    track(CLIP, "--box", BOX)
    assert (given["threads"], given["search"]) == (0, True)
    assert track(CLIP, "--box", BOX, "--threads", "-1").exit_code == 2
    assert track(CLIP, "--box", BOX, "--threads", "1.5").exit_code == 2
