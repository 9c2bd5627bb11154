"""The command line as users call it."""

import csv
import io
import re
import subprocess
import sys
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import re3
from re3.apps.cli import app
from re3.video import open_source

CLIP = Path(__file__).parents[2] / "examples" / "clips" / "person.mp4"
BOX = "368,58,158,374"


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


COMMANDS = (
    "track",
    "serve",
    "models",
    "eval",
    "compare",
    "bench",
    "vot",
    "qualitative",
    "tsne",
    "train",
    "ablate",
    "simulate",
    "export",
    "data",
    "weights",
)


@pytest.mark.parametrize("command", [*COMMANDS, "data check", "weights import", "weights show"])
def test_every_command_has_help_with_an_example(command):
    result = run(*command.split(), "--help")
    assert result.exit_code == 0
    assert "Example" in result.output
    assert f"re3 {command}" in result.output


def test_help_lists_every_command_with_what_it_does():
    found = get_command(app).commands
    assert tuple(found) == COMMANDS
    text = " ".join(re.sub(r"[^\w,.:;'-]+", " ", run("--help").output).split())
    for name, command in found.items():
        told = command.get_short_help_str(limit=200)
        assert told.endswith(".")
        assert f"{name} {told}" in text


def test_version():
    assert run("--version").output == f"re3 {re3.__version__}\n"


def test_models_lists_size_accuracy_and_speed():
    output = run("models").output
    for word in ("re3-lite", "MB", "AUC", "FPS"):
        assert word in output


def test_track_writes_video_and_results(tmp_path):
    out, boxes = tmp_path / "o.mp4", tmp_path / "b.csv"
    result = run("track", CLIP, "--box", BOX, "--max-frames", 12, "--out", out, "--results", boxes)
    assert result.exit_code == 0, result.output
    assert "tracking: " in result.output
    split = r"ms a frame without decoding and encoding: crops [\d.]+, network [\d.]+, rest [\d.]+\)"
    assert re.search(split, " ".join(result.output.split()))
    assert "12 frames" in result.output
    table = rows(boxes.read_text())
    assert [int(row["frame"]) for row in table] == list(range(12))
    first = [float(table[0][side]) for side in "xywh"]
    assert first == [368, 58, 158, 374]
    with av.open(str(out)) as container, av.open(str(CLIP)) as source:
        stream, original = container.streams.video[0], source.streams.video[0]
        assert (stream.width, stream.height) == (original.width, original.height)
        assert stream.average_rate == original.average_rate
        assert sum(1 for _ in container.decode(video=0)) == 12


def test_results_on_standard_output_are_nothing_but_csv():
    command = f"--box {BOX} --object table=440,80,146,260 --start-frame 3 --max-frames 4"
    done = subprocess.run(
        [sys.executable, "-m", "re3", "track", CLIP, *command.split(), "--results", "-"],
        capture_output=True,
        text=True,
        check=True,
    )
    table = rows(done.stdout)
    assert [(row["frame"], row["object"]) for row in table] == [
        (str(frame), name) for frame in range(3, 7) for name in ("object", "table")
    ]


def test_several_boxes_are_several_objects(tmp_path):
    out = tmp_path / "boxes.csv"
    run("track", CLIP, "--box", BOX, "--box", "440,80,146,260", "--max-frames", 2, "--results", out)
    first = [(row["object"], float(row["x"])) for row in rows(out.read_text())[:2]]
    assert first == [("object-1", 368), ("object-2", 440)]


def test_a_reader_that_goes_away_ends_the_run_quietly(tmp_path):
    out = tmp_path / "o.mp4"
    process = subprocess.Popen(
        [sys.executable, "-m", "re3", "track", CLIP, "--box", BOX, "--results", "-", "--out", out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline().startswith("frame,")
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=60) == 141
    assert err == ""
    with open_source(out) as source:
        assert 0 < len(list(source)) < source.frame_count + 1


def test_an_error_is_one_line(tmp_path):
    result = run("track", tmp_path / ("long" * 40), "--box", BOX)
    assert len(result.output.splitlines()) == 1


def test_nothing_slow_is_loaded_for_help():
    code = "import sys, re3.apps.cli; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_file_that_ends_early_is_noted(tmp_path):
    clip = tmp_path / "clip.avi"
    random = np.random.default_rng(0)
    with av.open(str(clip), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(30):
            image = random.integers(0, 255, (48, 64, 3), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    clip.write_bytes(clip.read_bytes()[: clip.stat().st_size // 2])
    result = run("track", clip, "--box", "10,10,20,20")
    assert result.exit_code == 1
    assert "frames more than it gave; is it complete?" in result.output


def test_a_source_that_breaks_keeps_what_was_tracked(tmp_path):
    frames = tmp_path / "frames"
    frames.mkdir()
    with open_source(CLIP) as source:
        for frame in source:
            if frame.index < 4:
                cv2.imwrite(str(frames / f"{frame.index}.png"), frame.image)
    (frames / "2.png").write_bytes(b"broken")
    result = run("track", frames, "--box", BOX, "--results", tmp_path / "b.csv")
    assert result.exit_code == 1
    assert "stopped early" in result.output
    assert "2.png" in result.output.replace("\n", "")
    assert len(rows((tmp_path / "b.csv").read_text())) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([CLIP], "no object to track; give its box in the first frame: --box X,Y,W,H"),
        ([CLIP, "--box", "1,2,3"], "--box '1,2,3' is not X,Y,W,H"),
        ([CLIP, "--box", "a,b,c,d"], "--box 'a,b,c,d' is not X,Y,W,H"),
        ([CLIP, "--box", "1,2,0,5"], "no area"),
        ([CLIP, "--box", "nan,2,5,5"], "NaN"),
        ([CLIP, "--box", "5000,5000,5,5"], "outside the frame of 768 x 432"),
        ([CLIP, "--object", "1,2,3,4"], "is not NAME=X,Y,W,H"),
        ([CLIP, "--object", "a=1,2,3,4", "--object", "a=5,6,7,8"], "two objects are called 'a'"),
        (["none.mp4", "--box", BOX], "'none.mp4' does not exist"),
        ([CLIP, "--box", BOX, "--start-frame", "500"], "no frame 500"),
        ([CLIP, "--box", BOX, "--start-frame", "5", "--end-frame", "4"], "--end-frame 4 is before"),
        ([CLIP, "--box", BOX, "--value-range", "5"], "--value-range '5' is not LOW,HIGH"),
        ([CLIP, "--box", BOX, "--value-range", "9,5"], "value range is 9 to 5"),
        (["", "--box", BOX], "the source is empty"),
        (["--box", BOX, "--", "-1"], "camera index is -1"),
        ([CLIP, "--box", BOX, "--model", "re4"], "unknown model 're4'"),
        ([CLIP, "--box", BOX, "--engine", "magic"], "unknown engine 'magic'"),
        ([CLIP, "--box", BOX, "--results", "r.xml"], "expected one of .csv"),
        ([CLIP, "--box", BOX, "--out", "o.avi"], "does not end in .mp4"),
        ([CLIP, "--box", BOX, "--out", CLIP], "is the source itself"),
    ],
)
def test_wrong_input_is_an_error_line_and_leaves_no_file(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    result = run("track", *arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []
