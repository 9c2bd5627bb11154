"""`re3 simulate` from outside."""

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.data.simulation_config import WAYS
from re3.video import open_source


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    for index in range(3):
        image = np.random.default_rng(index).integers(0, 120, (60, 80, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{index}.png"), image)
    return folder


def run(pictures, out, *options):
    arguments = ["simulate", "--stills", pictures, "--out", out, "--width", 160, *options]
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.parametrize("way", [*WAYS, "any"])
def test_frames_without_the_object_have_a_red_border(pictures, tmp_path, way):
    out = tmp_path / "clip.mp4"
    result = run(pictures, out, "--frames", 16, "--seed", 2, "--leaves", way)
    assert result.exit_code == 0, result.output
    boxes = np.loadtxt(out.with_suffix(".txt"), delimiter=",")
    absent = np.isnan(boxes[:, 0])
    assert 2 <= absent.sum() < 16
    with open_source(out) as frames:
        edges = np.array([frame.image[0].astype(int).mean(axis=0) for frame in frames])
    red = edges[:, 2] - edges[:, :2].max(axis=1) > 100
    np.testing.assert_array_equal(red, absent)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--leaves", "flies"), "--leaves is 'flies'; expected walks, camera, behind or any"),
        (("--leaves", "walks", "--frames", "5"), "--frames 5; expected 9 frames or more"),
    ],
)
def test_what_cannot_be_is_told(pictures, tmp_path, options, told):
    result = run(pictures, tmp_path / "clip.mp4", *options)
    assert result.exit_code == 2
    assert told in result.output
    assert not list(tmp_path.iterdir())
