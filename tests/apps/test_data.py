"""`re3 data check` from outside."""

import json

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app


def run(*arguments):
    return CliRunner().invoke(app, ["data", "check", *map(str, arguments)])


def clip(folder, name, images, boxes):
    """A clip in OTB's layout, of boxes in a frame of 64 x 48 pixels."""
    (folder / name / "img").mkdir(parents=True)
    for index in range(images):
        cv2.imwrite(
            str(folder / name / "img" / f"{index:04d}.png"), np.zeros((48, 64, 3), np.uint8)
        )
    lines = (",".join(map(str, box)) for box in boxes)
    (folder / name / "groundtruth_rect.txt").write_text("".join(f"{line}\n" for line in lines))


@pytest.fixture
def dataset(tmp_path):
    """Two sequences in OTB's layout; of the second a box lies outside the frame."""
    folder = tmp_path / "OTB"
    clip(folder, "Bolt", 3, [(5, 6, 20, 10), (6, 6, 20, 10), (0, 0, 0, 0)])
    clip(folder, "Car", 2, [(5, 6, 20, 10), (70, 6, 20, 10)])
    (folder / "Bolt" / "attrs.txt").write_text("FM, IV\n")
    return folder


def test_the_table_tells_what_is_there_and_what_is_odd(dataset):
    result = run(dataset)
    assert result.exit_code == 0, result.output
    words = " ".join(result.stdout.split())
    assert "Bolt 3 2 1 - 20 x 10 fast motion, illumination variation" in words
    assert "Car 2 2 0 - 20 x 10" in words
    assert "outside the frame in 1 of 2 frames, first in frame 1" in words
    assert "jump in 1 of 2 frames" in words
    assert "format otb, 2 sequences, 5 frames; 0 unusable, 1 with something odd" in words


def test_a_broken_sequence_is_listed_with_its_reason_and_the_rest_as_well(dataset):
    (dataset / "Bolt" / "groundtruth_rect.txt").write_text("1,2,3,4\n")
    result = run(dataset)
    assert result.exit_code == 1
    words = " ".join(result.stdout.split())
    assert "1 unusable, 1 with something odd" in words
    assert "Car 2 2 0" in words
    joined = "".join(result.stdout.split())
    assert "!" in joined
    assert "has1lines" in joined


def test_json_holds_the_same(dataset):
    (dataset / "Bolt" / "groundtruth_rect.txt").write_text("1,2,3,4\n")
    result = run(dataset, "--json")
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert (document["folder"], document["format"]) == (str(dataset), "otb")
    bolt, car = document["sequences"]
    assert "has 1 lines" in bolt["errors"][0]
    assert (car["name"], car["dataset"], car["boxes"], car["gaps"]) == ("Car", "OTB", 2, 0)
    assert (car["occluded"], car["median_size"]) == (None, [20, 10])
    assert (car["errors"], len(car["warnings"])) == ([], 2)


def test_frames_finds_broken_images(dataset):
    (dataset / "Bolt" / "img" / "0001.png").write_bytes(b"nothing")
    assert run(dataset).exit_code == 0
    result = run(dataset, "--frames", "--json")
    assert result.exit_code == 1
    bolt, car = json.loads(result.stdout)["sequences"]
    assert "0001.png cannot be read" in bolt["errors"][0]
    assert car["errors"] == []


def test_the_format_can_be_named(dataset):
    document = json.loads(run(dataset, "--format", "plain", "--json").stdout)
    assert (document["format"], len(document["sequences"])) == ("plain", 2)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["{data}/gone"], "gone does not exist"),
        (["{data}/Bolt/attrs.txt"], "is not a folder"),
        (["{data}/Bolt/img"], "holds no annotated clip in a known format"),
        (["{data}", "--format", "otb100"], "no format is called 'otb100'"),
        (["{data}", "--format", "davis"], "holds no clip in the format davis"),
    ],
)
def test_what_is_wrong_is_told_without_a_traceback(dataset, arguments, told):
    result = run(*(argument.format(data=dataset) for argument in arguments))
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_an_interrupted_check_says_so(dataset, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("re3.apps.data.check_dataset", interrupted)
    result = run(dataset)
    assert result.exit_code == 130
    assert "interrupted" in result.stderr


def test_help_has_an_example():
    assert "re3 data check GOT-10k/val" in run("--help").stdout
    assert "check" in CliRunner().invoke(app, ["data", "--help"]).stdout
