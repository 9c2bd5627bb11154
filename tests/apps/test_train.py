"""What `re3 train` finds to train on, and what it leaves."""

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("torch", reason="training needs torch (the train extra)")

from re3.apps.cli import app
from re3.apps.run_folder import RECIPE, read_starts
from re3.apps.train import _sampler, _start
from re3.network.variants import build
from re3.network.weights import save_weights
from re3.training.recipe import RECIPES
from re3.training.recipe_file import read_recipe
from re3.training.records import LOG, read_log


def clip(folder, name, truth):
    """Three pictures of 64 x 48 pixels in a folder, and a text of boxes somewhere."""
    folder.joinpath(name).mkdir(parents=True)
    for index in range(3):
        picture = np.zeros((48, 64, 3), np.uint8)
        cv2.imwrite(str(folder / name / f"{index:04d}.png"), picture)
    truth.write_text("5,6,20,10\n" * 3)


def still(folder):
    folder.mkdir(parents=True)
    cv2.imwrite(str(folder / "a.png"), np.zeros((48, 64, 3), np.uint8))
    box = '{"label": "dog", "box_xywh": [5, 6, 20, 20]}'
    (folder / "boxes.jsonl").write_text(
        f'{{"image": "a.png", "mask": null, "width": 64, "height": 48, "objects": [{box}]}}\n'
    )


@pytest.fixture
def data(tmp_path):
    """Plain clips, a dataset in OTB's layout and stills, one beside the other."""
    folder = tmp_path / "data"
    clip(folder / "sets" / "mine", "duck", folder / "sets" / "mine" / "duck.txt")
    bolt = folder / "sets" / "OTB" / "Bolt"
    clip(bolt, "img", bolt / "groundtruth_rect.txt")
    still(folder / "stills")
    return folder


def found(sampler):
    return {(s.dataset, s.name): s.boxes_xywh[0].tolist() for s in sampler.sequences}


def test_datasets_of_all_formats_and_stills_are_found(data):
    sampler = _sampler([data], set(), None)
    # OTB counts pixels from 1.
    assert found(sampler) == {("OTB", "Bolt"): [4, 5, 20, 10], ("mine", "duck"): [5, 6, 20, 10]}
    assert len(sampler.stills) == 1


def test_the_format_may_be_named_and_datasets_left_out(data):
    assert found(_sampler([data], set(), "otb")) == {("OTB", "Bolt"): [4, 5, 20, 10]}
    assert list(found(_sampler([data], {"OTB"}, None))) == [("mine", "duck")]


def test_clips_beside_stills_are_not_lost(data):
    clip(data, "loose", data / "loose.txt")
    sampler = _sampler([data], set(), None)
    assert set(found(sampler)) == {("OTB", "Bolt"), ("mine", "duck"), ("data", "loose")}
    assert len(sampler.stills) == 1


def test_stills_of_other_formats_are_found_and_may_be_named(data):
    (data / "yolo" / "images").mkdir(parents=True)
    (data / "yolo" / "labels").mkdir()
    cv2.imwrite(str(data / "yolo" / "images" / "b.png"), np.zeros((48, 64, 3), np.uint8))
    (data / "yolo" / "labels" / "b.txt").write_text("0 0.5 0.5 0.5 0.5\n")
    sampler = _sampler([data], set(), None)
    assert {still.dataset for still in sampler.stills} == {"stills", "yolo"}
    assert len(sampler.sequences) == 2
    (named,) = _sampler([data], set(), "yolo").stills
    assert named.dataset == "yolo"
    assert {s.dataset for s in _sampler([data], {"yolo"}, None).stills} == {"stills"}


def test_videos_and_stills_of_imagenet_may_share_a_folder(tmp_path):
    inner = tmp_path / "ILSVRC" / "Data"
    for name in ("VID/train/a/000000.JPEG", "VID/train/a/000001.JPEG", "DET/train/b.JPEG"):
        (inner / name).parent.mkdir(parents=True, exist_ok=True)
        _, encoded = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))
        (inner / name).write_bytes(encoded.tobytes())
        text = tmp_path / "ILSVRC" / "Annotations" / name.replace("JPEG", "xml")
        text.parent.mkdir(parents=True, exist_ok=True)
        text.write_text(
            "<annotation><size><width>64</width><height>48</height></size><object>"
            "<trackid>0</trackid><name>dog</name><occluded>0</occluded><generated>0</generated>"
            "<bndbox><xmin>5</xmin><ymin>6</ymin><xmax>24</xmax><ymax>25</ymax></bndbox>"
            "</object></annotation>"
        )
    sampler = _sampler([tmp_path], set(), None)
    assert [s.dataset for s in sampler.sequences] == ["ILSVRC-train"]
    assert [still.image.name for still in sampler.stills] == ["b.JPEG"]


@pytest.mark.parametrize(
    ("folder", "exclude", "told"),
    [
        ("gone", set(), "gone is not a folder; expected clips or stills in it"),
        ("sets/mine/duck", set(), "holds no annotated clip"),
        (".", {"got10k"}, r"no dataset \['got10k'\] to leave out; .* \['OTB', 'mine', 'stills'\]"),
    ],
)
def test_what_is_not_there_is_told(data, folder, exclude, told):
    with pytest.raises(ValueError, match=told):
        _sampler([data / folder], exclude, None)


def run(*arguments):
    # As wide as it takes: what is looked for must not be folded.
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, ["train", *map(str, arguments)])


def test_help_names_the_recipes():
    words = " ".join(run("--help").output.replace("│", " ").split())
    assert f"{', '.join(RECIPES)}, with --packed gpu, or a .yaml file" in words


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--recipe", "fast"], "no recipe 'fast'; expected one of frozen-trunk, paper"),
        (["--recipe", "gone.yaml"], "recipe gone.yaml does not exist"),
        (["--device", "tpu"], "unknown device 'tpu'; expected one of cpu, cuda"),
        (["--precision", "half"], "unknown precision 'half'; expected full or mixed"),
    ],
)
def test_options_that_cannot_be_used_are_told(data, tmp_path, arguments, told):
    done = run("--data", data, "--out", tmp_path / "run", *arguments)
    assert done.exit_code == 2
    assert told in done.output
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_weights_say_which_network_is_trained(tmp_path):
    save_weights(build("lite-C"), tmp_path / "c.safetensors")
    assert _start(None, tmp_path / "c.safetensors").spec().name == "lite-C"
    assert _start("lite-C", tmp_path / "c.safetensors").spec().name == "lite-C"
    told = r"c.safetensors holds weights of 'lite-C', not of 're3-lite'; give weights of that, or"
    with pytest.raises(ValueError, match=told):
        _start("re3-lite", tmp_path / "c.safetensors")
    assert _start(None, None).spec().name == "re3-lite"


def test_a_run_from_end_to_end(data, tmp_path):
    recipe, out = tmp_path / "two.yaml", tmp_path / "run"
    recipe.write_text("phases: [{unroll: 2, batch: 2, own: 0.5, iterations: 2}]\nwarm_up: 1\n")
    clips = data / "sets" / "mine"
    given = ["--data", data, "--out", out, "--val", clips, "--val-clips", 1, "--threads", 1]
    done = run(*given, "--recipe", recipe, "--seed", 5)
    assert done.exit_code == 0, done.output
    for name in ("re3-lite.onnx", "re3-lite-best.onnx", "re3-lite-best.safetensors"):
        assert (out / name).is_file()
    used = read_recipe(out / RECIPE)
    assert (used.iterations, used.seed) == (2, 5)
    entries = read_log(out / LOG)
    assert [entry["iteration"] for entry in entries] == [1, 2, 2, 2]
    assert "throughput" in entries[2]
    assert "phase 1 (unroll 2, batch 2): " in done.output
    assert set(entries[-1]["validation"]) == {"AUC", "drops", "accuracy", "robustness"}
    assert read_starts(out)[0]["iteration"] == 0

    # The recipe in the folder is the same run, which is over.
    again = run(*given, "--recipe", out / RECIPE)
    assert again.exit_code == 0, again.output
    assert "another recipe" not in again.output
    assert "iteration 2 of 2" in again.output
    other = run(*given, "--recipe", recipe, "--seed", 6)
    assert "note: the run goes on by another recipe: seed 5 -> 6" in other.output
    assert [start["iteration"] for start in read_starts(out)] == [0, 2, 2]
