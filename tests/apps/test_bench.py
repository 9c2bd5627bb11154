"""`re3 bench` as users call it."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.models import find_eight_bits

CLIP = Path(__file__).parents[2] / "examples" / "clips" / "person.mp4"


def bench(*arguments):
    return CliRunner().invoke(app, ["bench", *map(str, arguments)])


def test_it_measures_prints_and_writes(tmp_path):
    file = tmp_path / "speed.json"
    quick = ["--rounds", 2, "--frames", 3, "--no-memory", "--json", file]
    result = bench("--objects", "1,2", "--peers", "mosse", *quick)
    assert result.exit_code == 0, result.output
    for word in (
        "re3-lite",
        "re3-base",
        "mosse",
        "2 objects: time of an update",
        "What to choose here:",
    ):
        assert word in result.output
    written = json.loads(file.read_text())
    ours, base, mosse = written["trackers"]
    assert [each["name"] for each in written["trackers"]] == ["re3-lite", "re3-base", "mosse"]
    for each in (ours, base):
        assert each["size_bytes"] == find_eight_bits(each["name"]).stat().st_size
    assert [times["objects"] for times in ours["times"]] == [1, 2]
    one = ours["times"][0]
    assert 0 < one["crop"]["p50"] < one["update"]["p50"]
    assert 0 < one["network"]["p50"] < one["update"]["p50"]
    assert len(one["round_p50"]) == 2
    assert mosse["times"][0]["crop"]["p50"] is None
    assert ours["size_bytes"] > 1e6


def test_own_frames(tmp_path):
    file = tmp_path / "speed.json"
    box = "368,58,158,374"
    quick = ["--objects", 1, "--rounds", 1, "--frames", 2, "--peers", "none", "--no-memory"]
    result = bench("--source", CLIP, "--box", box, "--size", "own", "--json", file, *quick)
    assert result.exit_code == 0, result.output
    assert json.loads(file.read_text())["footage"]["box_xywh"] == [368, 58, 158, 374]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--box", "1,2,3,4"], "without --source"),
        (["--source", "clip.mp4"], "without --box; say where the object is"),
        (["--size", "big"], "not WIDTHxHEIGHT of 320x240 or more"),
        (["--objects", "1,0"], "--objects '1,0' is not whole numbers of 1 or more"),
        (["--threads", "two"], "--threads 'two' is not whole numbers of 0 or more"),
        (["--peers", "nobody"], "no tracker is called 'nobody'"),
        (["--engines", "cuda"], "unknown engine 'cuda'"),
        (["--crop-sizes", "200"], r"crop sizes [200] do not fit"),
        (["--plot", "speed.txt"], "does not end in .svg, .pdf or .png"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    result = bench(*arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
