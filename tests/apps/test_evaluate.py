"""`re3 eval`: protocols, failures and what is written, with trackers in their own processes."""

import csv
import json
import subprocess
import sys

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from re3.apps.evaluate import evaluate

FRAMES = 8

TRACKERS = """
class Stays:
    def init(self, frame, box_xywh):
        self.box = box_xywh

    def update(self, frame):
        return self.box, 0.5


class Breaks(Stays):
    def update(self, frame):
        raise RuntimeError("no more")
"""

app = typer.Typer()
app.command()(evaluate)


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(autouse=True)
def without_plots(monkeypatch):
    """Drawing takes seconds, and plots have tests of their own."""
    monkeypatch.setattr("re3.evaluation.plots_results.dataset_plots", lambda *_: [])


@pytest.fixture
def data(tmp_path, monkeypatch):
    """A folder `made` with the clips `still`, whose box stays, and `jumps`, where it goes away."""
    (tmp_path / "its_trackers.py").write_text(TRACKERS)
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "made"
    for name, jump in (("still", 0), ("jumps", 20)):
        (folder / name).mkdir(parents=True)
        for index in range(FRAMES):
            image = np.full((40, 60, 3), index, np.uint8)
            cv2.imwrite(str(folder / name / f"{index}.png"), image)
        boxes = [f"{4 + (jump if index >= 2 else 0)},4,8,8" for index in range(FRAMES)]
        (folder / f"{name}.txt").write_text("\n".join(boxes) + "\n")
    return folder


STAYS, BREAKS = "python:its_trackers:Stays", "python:its_trackers:Breaks"


def test_a_failure_is_told_and_the_rest_is_finished(data, tmp_path):
    (data / "jumps" / "5.png").write_bytes(b"no picture")
    out = tmp_path / "out"
    result = invoke(data, "-t", BREAKS, "-t", STAYS, "--out", out)
    assert result.exit_code == 1, result.output
    told = " ".join(result.stdout.split())
    assert "Breaks failed on still, frame 1: update raised RuntimeError: no more; the" in told
    assert "Stays failed on jumps, frame 5: cannot be read" in told
    assert "left out of the figures" in told
    with (out / "results.csv").open(newline="") as file:
        rows = {(row["tracker"], row["sequence"]): row for row in csv.DictReader(file)}
    assert len(rows) == 4
    assert rows["Stays", "still"]["failure"] == ""
    assert float(rows["Stays", "still"]["ao"]) == 1.0
    assert rows["Stays", "jumps"]["auc"] == ""  # nothing to be said of the tracker
    assert float(rows["Breaks", "still"]["ao"]) == 0.0
    document = json.loads((out / "results.json").read_text())
    breaks, stays = document["summary"]
    assert (breaks["failed"], stays["failed"]) == (2, 1)
    # The mean over the one sequence that could be read.
    assert (breaks["figures"]["ao"], stays["figures"]["ao"]) == (0.0, 1.0)
    assert document["notes"][0].startswith("Breaks failed on ")


def test_restarts_are_counted_and_kept_apart_from_one_pass(data, tmp_path):
    out = tmp_path / "out"
    assert invoke(data, "-t", STAYS, "--out", out).exit_code == 0
    result = invoke(data, "-t", STAYS, "--out", out, "--protocol", "ablation", "--resume")
    assert result.exit_code == 0, result.output
    assert "earlier run" not in result.stdout
    (row,) = json.loads((out / "ablation" / "results.json").read_text())["summary"]
    # Lost in the third frame of `jumps`; started again in the last, which does not count.
    assert (row["figures"]["drops"], row["figures"]["frames"]) == (1, 2 * FRAMES)
    assert row["figures"]["accuracy"] == pytest.approx(10 / 11)
    trajectory = (out / "ablation/made/Stays/jumps.txt").read_text().split()
    assert trajectory == ["1", "4,4,8,8", "2", "0", "0", "0", "0", "0"]
    again = invoke(data, "-t", STAYS, "--out", out, "--protocol", "ablation", "--resume")
    assert "all 2 results were taken from an earlier run" in again.stdout


@pytest.mark.parametrize(
    ("protocol", "inner", "heading", "title"),
    [
        ("ope", "", "AUC", "One-pass evaluation"),
        ("ablation", "ablation", "drops", "Ablation study, with restarts"),
        ("vot", "vot", "EAO", "VOT's supervised experiment, vot2016"),
    ],
)
def test_reports_lie_beside_the_boxes(data, tmp_path, protocol, inner, heading, title):
    pytest.importorskip("matplotlib", reason='needs matplotlib: pip install "re3[report]"')
    pytest.importorskip("jinja2", reason='needs Jinja: pip install "re3[report]"')
    out, file = tmp_path / "out", tmp_path / "deep" / "figures.json"
    arguments = ("--protocol", protocol, "--out", out, "--sequences", "still", "--json", file)
    result = invoke(data, "-t", STAYS, *arguments)
    assert result.exit_code == 0, result.output
    folder = out / inner
    assert sorted(path.name for path in folder.iterdir() if path.is_file()) == [
        "report.html",
        "report.md",
        "results.csv",
        "results.json",
    ]
    markdown = (folder / "report.md").read_text()
    assert markdown.startswith(f"# {title}\n")
    page = (folder / "report.html").read_text().replace("&#39;", "'")
    assert f"<h1>{title}</h1>" in page
    for text in (result.stdout, markdown, page):
        assert heading in text and f"made: 1 sequence, {protocol}" in text
    assert file.read_text() == (folder / "results.json").read_text()


def test_without_plots_the_figures_are_written_all_the_same(data, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    result = invoke(data, "-t", STAYS, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "no page and no plots: " in result.stderr and "re3[report]" in result.stderr
    for name in ("results.csv", "results.json", "report.md"):
        assert (tmp_path / "out" / name).is_file()


def test_vot_counts_failures_a_sequence(data, tmp_path):
    file = tmp_path / "vot.json"
    arguments = ("--protocol", "vot", "--vot-stack", "vot2014", "--json", file)
    result = invoke(data, "-t", STAYS, *arguments)
    assert result.exit_code == 0, result.output
    document = json.loads(file.read_text())
    assert document["protocol"] == "vot" and "vot2014" in document["conventions"]
    (row,) = document["summary"]
    assert (row["figures"]["failures"], row["figures"]["robustness"]) == (1, 0.5)
    assert row["figures"]["eao"] is None
    by_sequence = {r["sequence"]: r["failures"] for r in document["sequences"]}
    assert by_sequence == {"still": 0, "jumps": 1}


def test_all_boxes_together(data, tmp_path):
    out = tmp_path / "out"
    result = invoke(data, "-t", STAYS, "--protocol", "imagenet-vid", "--out", out)
    assert result.exit_code == 0, result.output
    (row,) = json.loads((out / "results.json").read_text())["summary"]
    assert (row["figures"]["tracks"], row["figures"]["boxes"]) == (2, 2 * FRAMES)
    # All of `still` and two frames of `jumps` are right.
    assert row["figures"]["auc"] == pytest.approx(10 / 16 * 20 / 21)


def test_repetitions_have_a_spread(data, tmp_path):
    file = tmp_path / "out" / "results.json"
    arguments = (data, "-t", "random-walk", "--repeat", "3", "--out", file.parent)
    result = invoke(*arguments, "--jobs", "2")
    assert result.exit_code == 0, result.output
    assert "±" in result.stdout
    assert "2 sequences ran at the same time, so no speeds are given" in result.stdout
    parallel = json.loads(file.read_text())
    assert (parallel["jobs"], parallel["timing_is_comparable"]) == (2, False)
    assert parallel["summary"][0]["sequences"] == 2
    assert parallel["summary"][0]["spread"]["ao"] > 0
    assert len(parallel["sequences"]) == 6
    assert invoke(*arguments).exit_code == 0
    alone = json.loads(file.read_text())
    assert alone["summary"][0]["figures"] == parallel["summary"][0]["figures"]
    assert alone["timing_is_comparable"]


def test_published_boxes_beside_ours(data, tmp_path):
    theirs = tmp_path / "Theirs"
    theirs.mkdir()
    for name in ("still", "jumps"):
        (theirs / f"{name}.txt").write_text((data / f"{name}.txt").read_text())
    file = tmp_path / "report.json"
    result = invoke(data, "-t", f"published:{theirs}", "-t", "first-box", "--json", file)
    assert result.exit_code == 0, result.output
    published, floor = json.loads(file.read_text())["summary"]
    assert (published["tracker"], published["fps"]) == ("Theirs", None)
    assert published["figures"]["ao"] == 1.0
    assert floor["figures"]["ao"] < 1.0 and floor["fps"] > 0


def test_occluded_frames_are_compared(data, tmp_path, monkeypatch):
    def marked(folder, format_name):
        from dataclasses import replace

        from re3.data.formats import read_dataset

        marks = np.arange(FRAMES) >= 4
        return [replace(sequence, occluded=marks) for sequence in read_dataset(folder)]

    refused = invoke(data, "-t", STAYS, "--occluded")
    assert refused.exit_code == 2
    assert "none of the 2 sequences does" in " ".join(refused.stderr.split())
    monkeypatch.setattr("re3.apps.sequences.read_dataset", marked)
    result = invoke(data, "-t", STAYS, "--occluded", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "8 of 16" in result.stdout
    (row,) = json.loads((tmp_path / "out" / "results.json").read_text())["occlusion"]
    # 10 of 16 boxes are right, 4 of the 8 in the second halves.
    assert row["relative_loss"] == pytest.approx((10 / 16 - 4 / 8) / (10 / 16))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--protocol", "otb"], "no protocol 'otb'; expected one of ope, tre, sre, starts"),
        (["--protocol", "vot", "--vot-stack", "vot1999"], "no VOT challenge 'vot1999'"),
        (["--protocol", "ablation", "--occluded"], "--occluded compares frames of one pass"),
        (["--format", "cd"], "no format is called 'cd'"),
        (["--timeout", "0"], "timeout is 0.0 seconds a frame"),
        (["-t", "published:{data}", "-p", "vot"], "published boxes of one pass"),
        (["-t", "published:{data}", "-p", "sre"], "published boxes of the clips as they are"),
        (["-t", "opencv:kfc"], "no tracker is called 'opencv:kfc'"),
    ],
)
def test_what_cannot_be_done_is_told(data, arguments, told):
    result = invoke(data, "-t", STAYS, *(argument.format(data=data) for argument in arguments))
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_in_this_process(data):
    result = invoke(data, "-t", BREAKS, "--jobs", "0", "--sequences", "still")
    assert result.exit_code == 1
    assert "Breaks failed on still, frame 1" in result.stdout


def test_workers_of_a_module_run_do_not_run_the_command_again(data, tmp_path):
    file = tmp_path / "results.json"
    command = ["eval", data, "-t", "first-box", "--sequences", "still", "--json", file]
    done = subprocess.run(
        [sys.executable, "-m", "re3", *map(str, command), "--jobs", "1"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert done.stdout.count("made: 1 sequence, ope") == 1
    assert "Traceback" not in done.stderr
    assert len(json.loads(file.read_text())["sequences"]) == 1


def test_starts_beside_the_truth_and_later_ones_make_a_row_a_clip(data, tmp_path):
    arguments = ("-t", STAYS, "--out", tmp_path / "out", "-s", "still")
    result = invoke(data, *arguments, "--protocol", "sre")
    assert result.exit_code == 0, result.output
    again = invoke(data, *arguments, "--protocol", "sre", "--resume")
    assert "all 12 results were taken from an earlier run" in " ".join(again.output.split())
    with (tmp_path / "out" / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    # It stays where it was put: beside the truth of 8 x 8 by .8 in one direction, or in both.
    moved, both = 7.2 * 8 / (128 - 57.6), 7.2**2 / (128 - 7.2**2)
    scaled = [0.8**2, 0.9**2, 1 / 1.1**2, 1 / 1.2**2]
    expected = sorted([moved] * 4 + [both] * 4 + scaled)
    assert sorted(float(row["ao"]) for row in rows) == pytest.approx(expected)
    (table,) = [
        t
        for t in (tmp_path / "out" / "report.md").read_text().split("###")
        if "AUC by sequence" in t
    ]
    assert "| still | 8 |" in table and "shifted" not in table
    later = invoke(data, *arguments, "--protocol", "tre")
    assert later.exit_code == 0 and "made-tre: 1 sequence" in later.output


def test_weights_of_a_training_run_are_run_as_an_exported_file(tmp_path):
    pytest.importorskip("torch", reason='needs torch: pip install "re3[train]"')
    from functools import partial

    from re3.apps.exported_weights import with_exported_weights
    from re3.evaluation.our_tracker import OurOptions, OurTracker
    from re3.evaluation.peers import find_tracker
    from re3.network.variants import build
    from re3.network.weights import save_weights

    weights = tmp_path / "mine.safetensors"
    save_weights(build("re3-lite"), weights)
    asked = [f"{weights}@mirror", f"{weights}@torch", "re3-lite", "first-box"]
    given = [find_tracker(name) for name in asked]
    made = with_exported_weights(given, tmp_path / "exported")
    assert [info.name for info in made] == [
        "mine@mirror",
        "mine@torch",
        "re3-lite",
        "first-box",
    ]
    assert isinstance(made[0].factory, partial)
    model, options = made[0].factory.args
    assert model.endswith("mine.onnx") and options == OurOptions(mirror=True)
    assert made[1:] == given[1:]
    frame = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)
    boxes = []
    for factory in (made[0].factory, partial(OurTracker, str(weights), options)):
        tracker = factory()
        tracker.init(frame, (40, 30, 40, 40))
        boxes.append(tracker.update(frame)[0])
    np.testing.assert_allclose(boxes[0], boxes[1], atol=0.5)


def test_a_file_without_weights_is_told(data, tmp_path):
    (tmp_path / "broken.safetensors").write_bytes(b"no weights")
    result = invoke(data, "-t", tmp_path / "broken.safetensors")
    assert result.exit_code == 2, result.output
    assert "broken.safetensors" in result.stderr and "Traceback" not in result.output


def test_the_subset_of_starts_is_one_figure_with_its_error(data, tmp_path):
    arguments = ("-t", STAYS, "--out", tmp_path / "out", "--protocol", "starts")
    result = invoke(data, *arguments)
    assert result.exit_code == 0, result.output
    (row,) = json.loads((tmp_path / "out" / "results.json").read_text())["summary"]
    # Both clips are short: one start in time, and six boxes beside the truth.
    assert (row["dataset"], row["sequences"], row["figures"]["clips"]) == ("made-starts", 14, 2)
    # `jumps` is away from its third frame on, in six of the seven frames that count.
    assert row["figures"]["lost"] == pytest.approx((0 + 6 / 7) / 2)
    assert row["figures"]["lost_error"] == pytest.approx(3 / 7)
    assert row["figures"]["ends_lost"] == 0.5
    report = (tmp_path / "out" / "report.md").read_text()
    assert "| made/still | 8 |" in report and "shifted" not in report
    again = invoke(data, *arguments, "--resume")
    assert "all 14 results were taken from an earlier run" in " ".join(again.output.split())
