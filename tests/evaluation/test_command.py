"""`re3 eval` from outside."""

import json

import pytest
import typer
from typer.testing import CliRunner

from re3.apps.evaluate import evaluate

app = typer.Typer()
app.command()(evaluate)


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_two_trackers_side_by_side(clips, tmp_path):
    out, file = tmp_path / "out", tmp_path / "deep" / "report.json"
    result = invoke(clips, "-t", "first-box", "-t", "medianflow", "--out", out, "--json", file)
    assert result.exit_code == 0, result.output
    assert "made: 2 sequences" in result.stdout
    assert "patch-late" in result.stdout
    for tracker in ("first-box", "medianflow"):
        for sequence in ("patch", "patch-late"):
            lines = (out / "made" / tracker / f"{sequence}.txt").read_text().splitlines()
            assert len(lines) == 12
    document = json.loads(file.read_text())
    assert document == json.loads((out / "results.json").read_text())
    assert (out / "report.md").read_text().startswith("# One-pass evaluation")
    floor, flow = document["summary"]
    assert (floor["tracker"], flow["tracker"]) == ("first-box", "medianflow")
    # The patch moves by its own width in 12 frames; MedianFlow follows it.
    assert floor["figures"]["auc"] < 0.5 < 0.8 < flow["figures"]["auc"]
    assert flow["fps"] > 1


def test_a_second_run_takes_over_what_is_there(clips, tmp_path, monkeypatch):
    # Drawing takes seconds.
    monkeypatch.setattr("re3.evaluation.plots_results.dataset_plots", lambda *_: [])
    out = tmp_path / "out"
    arguments = (clips, "-t", "first-box", "--sequences", "patch", "--out", out)
    assert invoke(*arguments).exit_code == 0
    assert "earlier run" not in invoke(*arguments).stdout
    again = invoke(*arguments, "--resume")
    assert "1 of 1 results of first-box on made were taken from an earlier run" in again.stdout


def test_only_the_sequences_named(clips, tmp_path):
    file = tmp_path / "report.json"
    result = invoke(clips, "-t", "first-box", "--sequences", " patch-late, ", "--json", file)
    assert result.exit_code == 0, result.output
    assert [row["sequence"] for row in json.loads(file.read_text())["sequences"]] == ["patch-late"]


@pytest.mark.parametrize("lines", [1, 9])
def test_an_annotation_that_ends_before_its_clip_is_refused_unless_asked(clips, tmp_path, lines):
    truth = clips / "patch.txt"
    truth.write_text("".join(truth.read_text().splitlines(keepends=True)[:lines]))
    file = tmp_path / "report.json"
    arguments = (clips, "-t", "first-box", "--json", file)
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert f"patch has {lines} boxes for 12 frames" in result.stderr
    assert "--short-truth" in result.stderr
    assert not file.exists()
    # The other clip is complete.
    assert invoke(*arguments, "--sequences", "patch-late").exit_code == 0
    result = invoke(*arguments, "--short-truth")
    assert result.exit_code == 0, result.output
    patch = json.loads(file.read_text())["sequences"][0]
    assert patch["frames"] == lines
    # The box that the tracker was given is compared with nothing.
    assert (patch["auc"] is None) == (lines == 1)
    assert ("truth in the frame of the start alone" in " ".join(result.stdout.split())) == (
        lines == 1
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "no data given"),
        (["{clips}/gone", "-t", "first-box"], "gone does not exist"),
        (["{clips}/patch.txt", "-t", "first-box"], "is not a folder"),
        (["{clips}/patch", "-t", "first-box"], "holds no annotated clip"),
        (["{clips}", "-t", "kfc"], "no tracker is called 'kfc'"),
        (["{clips}", "-t", "gone.onnx"], "gone.onnx does not exist"),
        (["{clips}", "--model", "gone.onnx"], "gone.onnx does not exist"),
        (["{clips}", "--peers", "{clips}/gone", "-t", "kcf"], "gone is not a folder"),
        (["{clips}", "-t", "first-box", "--sequences", "a,patch"], "no sequence is called a"),
        (["{clips}", "-t", "first-box", "--sequences", ","], "names none"),
        (["{clips}", "-t", "first-box", "--resume"], "resume needs the folder"),
        (["{clips}", "{clips}", "-t", "first-box"], "two sequences are called 'made/patch'"),
    ],
)
def test_what_is_wrong_is_told_without_a_traceback(clips, arguments, told):
    result = invoke(*(argument.format(clips=clips) for argument in arguments))
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_a_spoilt_annotation_names_file_and_line(clips):
    path = clips / "patch.txt"
    path.write_text(path.read_text().replace("33,22,40,32", "33,22,forty,32"))
    result = invoke(clips, "-t", "first-box")
    assert result.exit_code == 2
    assert "patch.txt, line 2" in " ".join(result.stderr.split())


def test_an_interrupted_run_says_how_to_go_on(clips, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("re3.apps.evaluate.run", interrupted)
    result = invoke(clips, "-t", "first-box", "--out", tmp_path / "out")
    assert result.exit_code == 130
    assert "go on with --resume" in result.stderr


def test_the_trackers_known_are_listed():
    result = invoke("--list")
    assert result.exit_code == 0
    for name in ("re3-lite", "first-box", "kcf-persistent", "nanotrack-v3"):
        assert name in result.stdout


def test_help_has_an_example():
    result = invoke("--help")
    assert result.exit_code == 0
    assert "re3 eval data/davis -t re3-lite" in result.stdout
