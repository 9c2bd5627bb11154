"""`re3 vot`: the official toolkit over TraX, and our figures beside its own."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from re3.apps.vot import vot
from re3.data.plain import read_track
from re3.evaluation.peers import find_tracker
from re3.evaluation.supervised import SupervisedConfig, run_supervised
from re3.evaluation.vot import STACKS, VotStack, pixel_overlaps, score_vot
from re3.evaluation.vot_results import read_analysis, read_runs
from re3.evaluation.vot_toolkit import HOW_TO_INSTALL
from re3.video import open_source

CLIP = Path(__file__).parents[2] / "examples" / "clips" / "person.mp4"
PERSON = (384, 14, 128, 378)
"""Drawn by hand at frame 30 of the clip; she stands still from frame 24 to 104."""
SIZE = (256, 192)
LENGTH = 32
INTERVAL = (3, 24)

toolkit = pytest.mark.skipif(
    importlib.util.find_spec("vot") is None or importlib.util.find_spec("trax") is None,
    reason=f"needs the VOT toolkit: {HOW_TO_INSTALL}",
)

app = typer.Typer()
app.command()(vot)


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """Five clips of the standing person, as a camera would film her that moves and zooms."""
    with open_source(CLIP, start_frame=24) as source:
        frames = [frame.image for _, frame in zip(range(78), source, strict=False)]
    t = np.arange(LENGTH)
    # Of each frame: the point of the picture in the middle, and pixels out for a pixel in.
    paths = {
        "pan": (448 + 3 * (t - 16), 203 + t, np.full(LENGTH, 0.4)),
        "zoom": (np.full(LENGTH, 440), np.full(LENGTH, 203), 0.3 * 1.02**t),
        "shake": (448 + 25 * np.sin(t), 203 + 20 * np.cos(1.7 * t), np.full(LENGTH, 0.4)),
        # The camera turns to another place twice: only one who is told finds her again.
        "jump": (448 + 200 * (t // 11 % 2) - 100, np.full(LENGTH, 203), np.full(LENGTH, 0.3)),
        # She leaves the picture by and by, but not wholly.
        "leave": (448 + 11 * t, np.full(LENGTH, 203), np.full(LENGTH, 0.4)),
    }
    folder = tmp_path_factory.mktemp("clips") / "filmed"
    for number, (name, path) in enumerate(paths.items()):
        (folder / name).mkdir(parents=True)
        lines = []
        for index, (x, y, zoom) in enumerate(zip(*path, strict=True)):
            dx, dy = SIZE[0] / 2 - zoom * x, SIZE[1] / 2 - zoom * y
            matrix = np.array([[zoom, 0, dx], [0, zoom, dy]])
            image = cv2.warpAffine(frames[11 * number + index], matrix, SIZE, flags=cv2.INTER_AREA)
            cv2.imwrite(str(folder / name / f"{index:04d}.png"), image)
            left, top, width, height = (zoom * value for value in PERSON)
            box = (left + dx, top + dy, width, height)
            lines.append(",".join(f"{value:.3f}" for value in box) + "\n")
        (folder / f"{name}.txt").write_text("".join(lines))
    return folder


@pytest.fixture(scope="module")
def evaluated(filmed, tmp_path_factory):
    """The workspace after the command, and what it printed."""
    workspace = tmp_path_factory.mktemp("vot") / "a workspace"
    arguments = ("--workspace", workspace, "--repetitions", 1, "--interval", "3,24")
    result = invoke(filmed, "-t", "re3-lite", "-t", "first-box", *arguments)
    assert result.exit_code == 0, result.output
    return workspace, result.stdout


@toolkit
@pytest.mark.slow
def test_toolkit_and_we_agree_on_real_trajectories(evaluated):
    workspace, printed = evaluated
    stack = VotStack("vot2016", "vot2016/rgb", INTERVAL, repetitions=1)
    identifiers = ["re3-lite", "first-box"]
    names = (workspace / "sequences" / "list.txt").read_text().split()
    assert sorted(names) == ["jump", "leave", "pan", "shake", "zoom"]
    official = read_analysis(workspace / "analysis" / "re3.json", identifiers, stack)
    document = json.loads((workspace / "analysis" / "re3.json").read_text())
    for row, (identifier, theirs) in enumerate(zip(identifiers, official, strict=True)):
        ours = score_vot(read_runs(workspace, identifier, names, 1), stack)
        assert ours.accuracy == pytest.approx(theirs.accuracy, abs=1e-12)
        assert ours.robustness == pytest.approx(theirs.robustness, abs=1e-12)
        assert ours.reliability == pytest.approx(theirs.reliability, abs=1e-12)
        assert ours.failures == theirs.failures
        # The toolkit sums the curve in float32.
        assert ours.eao == pytest.approx(theirs.eao, abs=1e-6)
        curve = document["results"]["baseline"]["results"][3][row][0]
        np.testing.assert_allclose(ours.curve, curve, atol=1e-6)
        assert f"{theirs.eao:.4f}" in printed
    tracker, floor = official
    assert floor.failures >= 2
    assert tracker.eao > floor.eao
    assert tracker.accuracy > 0.5


@toolkit
@pytest.mark.slow
def test_the_toolkit_gets_the_trajectory_that_we_get(evaluated, filmed):
    workspace, _ = evaluated
    config = SupervisedConfig(STACKS["vot2016"].restart_after, by_pixels=True)
    drops = 0
    clips = ["jump", "leave", "pan", "shake", "zoom"]
    for tracker, name in [("re3-lite", "jump"), *(("first-box", clip) for clip in clips)]:
        ours = run_supervised(find_tracker(tracker).factory, read_track(filmed / name), config)
        (theirs,) = read_runs(workspace, tracker, [name], 1)
        drops += ours.drops
        np.testing.assert_array_equal(theirs.runs[0].steps, ours.steps)
        # TraX sends boxes as text of four decimals.
        np.testing.assert_allclose(theirs.runs[0].boxes_xywh, ours.boxes_xywh, atol=2e-3)
    assert drops >= 2  # so restarts are compared too


@toolkit
@pytest.mark.slow
def test_what_was_run_is_not_run_again(evaluated, filmed):
    workspace, printed = evaluated
    # A tracker that cannot start would end another run.
    registry = workspace / "trackers.ini"
    arguments = (filmed, "-t", "re3-lite", "-t", "first-box", "--workspace", workspace)
    again = invoke(*arguments, "--repetitions", 1, "--interval", "3,24", "--no-run")
    assert again.exit_code == 0, again.output
    assert again.stdout == printed
    assert "re3.apps.trax_server --tracker re3-lite" in registry.read_text()
    times = [path.stat().st_mtime_ns for path in sorted((workspace / "results").rglob("*.txt"))]
    # With one sequence less the same trajectories give other figures.
    fewer = invoke(*arguments, "--sequences", "pan,jump", "--repetitions", 1, "--interval", "3,24")
    assert fewer.exit_code == 0, fewer.output
    assert "2 sequences" in fewer.stdout
    assert times == [p.stat().st_mtime_ns for p in sorted((workspace / "results").rglob("*.txt"))]
    short = invoke(*arguments, "--repetitions", 1, "--no-run")
    assert "no EAO: the longest stretch has 32 frames and vot2016 averages from 108 on" in (
        " ".join(short.stdout.split())
    )


@toolkit
@pytest.mark.slow
def test_a_tracker_that_fails_ends_the_command_with_its_reason(filmed, tmp_path):
    # The toolkit itself exits with 0.
    workspace = tmp_path / "w"
    result = invoke(filmed, "-s", "pan", "-t", "bad=trax:false", "--workspace", workspace)
    assert result.exit_code == 2
    told = " ".join(result.stderr.split())
    assert "`vot evaluate bad --experiments baseline` failed (exit code 0)" in told
    assert "Tracker bad encountered an error at sequence pan" in told
    assert "tracker false: Unable to connect to tracker" in told
    assert "Traceback" not in result.output
    assert not (workspace / "analysis").exists()


@toolkit
def test_overlap_is_the_toolkits():
    code = (
        "import json, sys; from vot.region import Rectangle, calculate_overlaps;"
        "a, b = ([Rectangle(*box) for box in boxes] for boxes in json.load(sys.stdin));"
        "print(json.dumps(calculate_overlaps(a, b, (80, 70))))"
    )
    random = np.random.default_rng(0)
    truth = np.c_[random.uniform(-20, 90, (600, 2)), random.uniform(0, 50, (600, 2))]
    boxes = np.c_[truth[:, :2] + random.normal(0, 8, (600, 2)), random.uniform(0, 50, (600, 2))]
    # Halves, and boxes of no pixel, one and two.
    truth[:200], boxes[:200] = np.round(2 * truth[:200]) / 2, np.round(2 * boxes[:200]) / 2
    truth[200:400, 2:] = random.integers(0, 3, (200, 2))
    boxes[200:400] = truth[200:400] + random.integers(-1, 2, (200, 4)) * [1, 1, 0, 0]
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps([boxes.tolist(), truth.tolist()]),
        capture_output=True,
        text=True,
        check=True,
    )
    expected = np.array(json.loads(done.stdout))
    assert 0 < np.count_nonzero(expected == 1) < np.count_nonzero(expected == 0) < 500
    np.testing.assert_allclose(pixel_overlaps(boxes, truth, (80, 70)), expected, atol=1e-12)


@toolkit
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["{clips}", "--stack", "vot2099"], "no VOT challenge 'vot2099'"),
        (["{clips}", "--interval", "5"], "--interval '5' is not LOW,HIGH"),
        (["{clips}", "--interval", "9,5"], "0 <= low <= high"),
        (["{clips}", "--sequences", "gone"], "no sequence is called gone"),
        (["{clips}", "-t", "kfc"], "no tracker is called 'kfc'"),
        (["{clips}/gone"], "gone does not exist"),
        (["{clips}", "{clips}", "-t", "first-box"], "two sequences are called 'filmed-jump'"),
        (["{clips}", "-t", "first-box", "--no-run"], "run without --no-run"),
    ],
)
def test_what_is_wrong_is_told_without_a_traceback(filmed, tmp_path, arguments, told):
    result = invoke(*(a.format(clips=filmed) for a in arguments), "--workspace", tmp_path / "w")
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_without_the_toolkit_the_error_says_how_to_get_it(filmed, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    result = invoke(filmed, "--workspace", tmp_path / "w")
    assert result.exit_code == 2
    assert HOW_TO_INSTALL in " ".join(result.stderr.split())


def test_help_has_an_example():
    result = invoke("--help")
    assert result.exit_code == 0
    assert "re3 vot data/vot2016 -t re3-lite" in result.stdout
