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


def stills(folder, **broken):
    """Three pictures of 64 x 48 pixels with a box each, in COCO's layout and in YOLO's.

    `broken` puts a key of COCO's annotation 2 in place.
    """
    images, annotations = [], []
    for index in range(3):
        coco = folder / "coco" / "val"
        yolo = folder / "yolo" / "images"
        for each in (coco, yolo):
            each.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(each / f"{index}.png"), np.zeros((48, 64, 3), np.uint8))
        (folder / "yolo" / "labels").mkdir(exist_ok=True)
        (folder / "yolo" / "labels" / f"{index}.txt").write_text("0 0.5 0.5 0.25 0.25\n")
        image = {"id": index, "file_name": f"{index}.png", "width": 64, "height": 48}
        ring = [10, 6, 30, 6, 30, 20, 10, 20]
        found = {"id": index + 1, "image_id": index, "bbox": [10, 6, 20, 14]}
        images.append(image)
        annotations.append({**found, "segmentation": [ring], **(broken if index == 1 else {})})
    (folder / "coco" / "annotations").mkdir()
    (folder / "coco" / "annotations" / "instances_val.json").write_text(
        json.dumps({"images": images, "annotations": annotations})
    )
    return folder


@pytest.mark.parametrize(("name", "outlines"), [("coco", 3), ("yolo", 0)])
def test_stills_are_checked(tmp_path, name, outlines):
    result = run(stills(tmp_path) / name)
    assert result.exit_code == 0, result.output
    assert (
        f"stills in the format {name}, 3 pictures, 3 objects, {outlines} of them with an outline; "
        "0 unusable, 0 with something odd" in " ".join(result.stdout.split())
    )
    document = json.loads(run(tmp_path / name, "--json", "--format", name).stdout)
    assert (document["format"], document["sequences"]) == (name, [])
    assert document["stills"] == {
        "formats": [name], "pictures": 3, "objects": 3, "outlines": outlines, "findings": []
    }  # fmt: skip


@pytest.mark.parametrize(
    ("broken", "code", "told"),
    [
        ({"segmentation": [[]]}, 0, "annotation 2 of 1.png: no outline"),
        ({"bbox": [70, 0, 5, 5]}, 0, "1 of 1 boxes outside the picture"),
        ({"bbox": [1, 1, 0, 5]}, 0, "1 of 1 boxes without an area"),
        ({"bbox": [1, 1]}, 1, "annotation 2 of 1.png: a bbox of 2 numbers"),
    ],
)
def test_what_is_wrong_with_a_picture_is_told_and_the_rest_is_read(tmp_path, broken, code, told):
    result = run(stills(tmp_path, **broken) / "coco", "--json")
    assert result.exit_code == code, result.output
    report = json.loads(result.stdout)["stills"]
    (finding,) = report["findings"]
    assert finding["name"] == "1.png"
    assert told in (finding["errors"] + finding["warnings"])[0]
    assert bool(finding["errors"]) == bool(code)
    assert report["objects"] == (3 if code == 0 and "area" not in told else 2)


@pytest.mark.parametrize("name", ["coco", "yolo"])
def test_pictures_that_are_missing_or_broken_are_told(tmp_path, name):
    folder = stills(tmp_path) / name
    pictures = sorted(folder.rglob("*.png"))
    if name == "coco":
        pictures[0].unlink()
    else:  # of YOLO the texts of images are read
        (folder / "labels" / "0.txt").write_text("0 0.5\n")
    pictures[1].write_bytes(b"nothing")
    pictures[2].write_bytes(pictures[2].read_bytes()[:60])
    report = json.loads(run(folder, "--json").stdout)["stills"]
    assert [finding["name"] for finding in report["findings"]] == ["0.png", "1.png"]
    # The header of the last is whole; only decoding finds that the rest is missing.
    result = run(folder, "--frames", "--json")
    assert result.exit_code == 1
    report = json.loads(result.stdout)["stills"]
    assert [finding["name"] for finding in report["findings"]] == ["0.png", "1.png", "2.png"]
    assert all(finding["errors"] for finding in report["findings"])


def test_sequences_and_stills_in_one_folder_are_both_checked(dataset):
    stills(dataset.parent)
    document = json.loads(run(dataset.parent, "--json").stdout)
    assert document["format"] == "otb and coco and yolo"
    assert len(document["sequences"]) == 2
    assert document["stills"]["pictures"] == 6


def test_a_folder_of_neither_is_told(tmp_path):
    result = run(tmp_path)
    assert result.exit_code == 2
    assert "nor annotated stills" in result.stderr
