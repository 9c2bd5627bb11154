"""Failure by whole pixels: what `re3 eval --protocol vot` and the toolkit call lost is the same."""

import importlib.util
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from fake_trackers import Grazes
from typer import Typer
from typer.testing import CliRunner

from re3.apps.evaluate import evaluate
from re3.apps.vot import vot
from re3.data.formats import read_dataset
from re3.evaluation.supervised import VOT, Step, SupervisedConfig, run_supervised
from re3.evaluation.vot_results import read_runs
from re3.evaluation.vot_toolkit import HOW_TO_INSTALL

SIZE = (120, 90)
FRAMES = 14
TRACKER = "python:fake_trackers:Grazes"

toolkit = pytest.mark.skipif(
    importlib.util.find_spec("vot") is None or importlib.util.find_spec("trax") is None,
    reason=f"needs the VOT toolkit: {HOW_TO_INSTALL}",
)

app = Typer()
app.command("eval")(evaluate)
app.command("vot")(vot)


def invoke(*arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """A VOT folder of upright boxes at places that are no whole pixels, marked as occluded."""
    folder = tmp_path_factory.mktemp("data") / "vot2016"
    for name, (x, y) in {"half": (20.5, 30.0), "third": (40.3, 20.7)}.items():
        (folder / name).mkdir(parents=True)
        for index in range(FRAMES):
            image = np.full((SIZE[1], SIZE[0], 3), 10 * index, np.uint8)
            cv2.imwrite(str(folder / name / f"{index + 1:08d}.jpg"), image)
        lines = [f"{x + 0.1 * t:.3f},{y:.3f},20.4,15.6" for t in range(FRAMES)]
        (folder / name / "groundtruth.txt").write_text("\n".join(lines) + "\n")
        (folder / name / "occlusion.tag").write_text("0\n0\n1\n1\n")
    (folder / "list.txt").write_text("half\nthird\n")
    return folder


def test_a_box_that_overlaps_by_less_than_a_pixel_may_have_failed(data):
    (sequence, _) = read_dataset(data)
    exact = run_supervised(Grazes, sequence, SupervisedConfig())
    pixels = run_supervised(Grazes, sequence, VOT)
    assert exact.drops == 0
    assert pixels.drops > 0
    assert (pixels.steps == Step.FOLLOWED).any()


@toolkit
@pytest.mark.slow
def test_the_toolkit_fails_in_the_same_frames(data, tmp_path, monkeypatch):
    # The toolkit's process has to find the tracker.
    here = Path(__file__).parent
    monkeypatch.setenv("PYTHONPATH", f"{here}:{here.parents[1] / 'src'}")
    workspace = tmp_path / "w"
    arguments = ("--repetitions", 1, "--interval", "1,4", "--workspace", workspace)
    invoke("vot", data, "-t", f"grazes={TRACKER}", *arguments)
    drops = []
    for sequence in read_dataset(data):
        (theirs,) = read_runs(workspace, "grazes", [sequence.name], 1)
        ours = run_supervised(Grazes, sequence, VOT)
        np.testing.assert_array_equal(ours.steps, theirs.runs[0].steps)
        drops.append(ours.drops)
    assert min(drops) > 0
    # Both commands print the same figures.
    file = tmp_path / "figures.json"
    options = ("--protocol", "vot", "--interval", "1,4", "--jobs", 0, "--json", file)
    invoke("eval", data, "-t", f"grazes={TRACKER}", *options)
    official = json.loads((workspace / "analysis" / "re3.json").read_text())
    accuracy, robustness = official["results"]["baseline"]["results"][0][0][:2]
    figures = json.loads(file.read_text())["summary"][0]["figures"]
    assert figures["accuracy"] == pytest.approx(accuracy, abs=1e-9)
    assert figures["robustness"] == pytest.approx(robustness, abs=1e-9)
    assert figures["failures"] == sum(drops)


def test_eval_takes_an_interval_and_shows_occluded_frames(data, tmp_path):
    file = tmp_path / "figures.json"
    common = ("eval", data, "-t", "first-box", "--protocol", "vot", "--jobs", 0, "--json", file)
    printed = invoke(*common)
    assert "give --interval LOW,HIGH for shorter sequences" in " ".join(printed.split())
    printed = invoke(*common, "--interval", "1,9", "--occluded", "--out", tmp_path / "out")
    assert "EAO occluded" in printed
    figures = json.loads(file.read_text())["summary"][0]["figures"]
    assert 0.8 < figures["eao"] <= 1
    assert figures["eao_occluded"] == pytest.approx(figures["eao"], abs=0.1)
    assert (tmp_path / "out" / "vot" / "plots" / "occlusion-vot2016.svg").is_file()
    # Asked for, it is a figure without marks, too.
    for tag in data.glob("*/occlusion.tag"):
        tag.rename(tag.with_suffix(".off"))
    result = CliRunner().invoke(app, [*map(str, common), "--interval", "1,9", "--occluded"])
    assert result.exit_code == 2
    assert "none of the 2 sequences does" in " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--interval", "1,4"], "--interval is of --protocol vot, not of ope"),
        (["--protocol", "vot", "--interval", "4"], "is not LOW,HIGH"),
        (["--protocol", "vot", "--otb-rules"], "not of vot"),
        (["--protocol", "ablation", "--occluded"], "Take ope, imagenet-vid or vot"),
    ],
)
def test_options_of_other_protocols_are_refused(data, options, told):
    result = CliRunner().invoke(app, ["eval", str(data), "-t", "first-box", *options])
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
