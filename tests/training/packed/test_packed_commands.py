"""`re3 data pack` and `re3 train --packed`, as a user runs them."""

import json

import pytest
from packed_material import make_sources
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.models import WEIGHTS

RECIPE = """
learning_rate: 1e-4
stages:
  - {until: 1.0, unroll: 1, batch: 2, own: 0.5}
"""


@pytest.fixture(scope="module")
def mix(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mix")
    (folder / "films").mkdir()
    (folder / "pictures").mkdir()
    films, pictures = make_sources(folder)
    clip = films.sequences[0]
    clip.source.rename(folder / "films" / "clip.mp4")
    lines = [",".join(f"{v:g}" for v in box) for box in clip.boxes_xywh]
    (folder / "films" / "clip.txt").write_text("\n".join(lines) + "\n")
    rows = []
    for still in pictures.stills:
        for path in (still.image, still.image.with_name(f"{still.image.stem}-mask.png")):
            path.rename(folder / "pictures" / path.name)
        rows.append(
            {
                "image": still.image.name,
                "mask": f"{still.image.stem}-mask.png",
                "width": 140,
                "height": 100,
                "objects": [{"label": "disc", "box_xywh": still.boxes_xywh[0].tolist()}],
            }
        )
    (folder / "pictures" / "boxes.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    (folder / "mix.yaml").write_text(
        "sources:\n  - {path: films, kind: videos}\n  - {path: pictures, kind: stills}\n"
    )
    return folder / "mix.yaml"


@pytest.fixture(scope="module")
def shards(mix):
    done = CliRunner().invoke(
        app, ["data", "pack", str(mix), "-o", str(mix.parent / "packed"), "-j1"]
    )
    assert done.exit_code == 0, done.output
    assert "4 videos and stills in 1 shards" in done.output
    return mix.parent / "packed"


def test_training_from_shards_ends_with_a_network(shards, tmp_path):
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(RECIPE)
    out = tmp_path / "run"
    command = ["train", "--packed", str(shards), "--recipe", str(recipe), "--out", str(out)]
    done = CliRunner().invoke(app, [*command, "--iterations", "1", "--workers", "0"])
    assert done.exit_code == 0, done.output
    assert "1 tracks, 3 stills" in done.output
    assert {"re3-lite.onnx", "re3-lite.safetensors", "checkpoint.pt", "log.jsonl"} <= {
        path.name for path in out.iterdir()
    }
    assert "unroll: 1" in (out / "recipe.yaml").read_text()
    again = CliRunner().invoke(app, [*command, "--iterations", "2", "--workers", "0"])
    assert again.exit_code == 0, again.output
    assert json.loads((out / "run.json").read_text())["starts"][1]["iteration"] == 1


@pytest.mark.parametrize(
    "options, word",
    [
        (["--data", "."], "--packed has data"),
        (["--minutes", "1", "--iterations", "1"], "expected one of them"),
        (["--recipe", "frozen-trunk"], "no recipe 'frozen-trunk' for packed data"),
        (["--model", "re3"], "cannot train 're3'"),
    ],
)
def test_options_that_do_not_go_together(shards, tmp_path, options, word):
    command = ["train", "--packed", str(shards), "--out", str(tmp_path / "run"), *options]
    done = CliRunner().invoke(app, command)
    assert done.exit_code != 0
    assert word in " ".join(done.output.split())


def test_a_folder_without_shards(tmp_path):
    done = CliRunner().invoke(app, ["train", "--packed", str(tmp_path), "-o", str(tmp_path / "o")])
    assert done.exit_code != 0
    assert "re3 data pack" in " ".join(done.output.split())


def test_minutes_are_for_packed_data(tmp_path):
    done = CliRunner().invoke(app, ["train", "-d", str(tmp_path), "--minutes", "1"])
    assert done.exit_code != 0
    assert "for --packed" in " ".join(done.output.split())


def test_weights_of_another_size_are_a_start(shards, tmp_path):
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(RECIPE)
    init = WEIGHTS / "re3-lite.onnx"
    command = ["train", "--packed", str(shards), "--recipe", str(recipe), "--init", str(init)]
    command += ["--model", "re3-lite-wide", "--iterations", "1", "--workers", "0"]
    done = CliRunner().invoke(app, [*command, "--out", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "run" / "re3-lite-wide.onnx").is_file()
