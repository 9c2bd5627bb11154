"""`re3 data stats`, `re3 data show` and `re3 train --mix` from outside."""

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.apps.train import _sampler

pytest.importorskip("yaml", reason="mixes need PyYAML (the train extra)")

MIX = """
simulated: 0.5
sources:
  - {path: videos, kind: videos}
  - {path: stills, kind: stills}
"""


def run(*arguments):
    return CliRunner().invoke(app, ["data", *map(str, arguments)])


@pytest.fixture
def data(tmp_path, monkeypatch):
    """A walking square, a picture with a label, and a mix of both."""
    monkeypatch.setenv("RE3_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "data"
    (folder / "videos" / "duck").mkdir(parents=True)
    for t in range(20):
        image = np.full((48, 64, 3), 40, np.uint8)
        image[10:30, 2 + 2 * t : 22 + 2 * t] = 220
        cv2.imwrite(str(folder / "videos" / "duck" / f"{t:04d}.png"), image)
    lines = (f"{2 + 2 * t},10,20,20\n" if t != 19 else "nan,nan,nan,nan\n" for t in range(20))
    (folder / "videos" / "duck.txt").write_text("".join(lines))
    for name in ("images", "labels"):
        (folder / "stills" / name).mkdir(parents=True)
    noise = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    cv2.imwrite(str(folder / "stills" / "images" / "a.png"), noise)
    (folder / "stills" / "labels" / "a.txt").write_text("0 0.5 0.5 0.4 0.4\n")
    (folder / "mix.yaml").write_text(MIX)
    return folder


def test_stats_prints_what_is_drawn(data):
    result = run("stats", data / "mix.yaml", "--clips", 40, "--frames", 4)
    assert result.exit_code == 0, result.output
    words = " ".join(result.stdout.split())
    assert "videos videos" in words
    assert "50.0%" in words
    assert "20 20 20" in words  # the size of the square
    assert "40 clips of 4 frames" in words
    assert not (data.parent / "cache").exists()  # no video was decoded


def test_stats_takes_folders_as_train_does(data):
    result = run("stats", data, "--clips", 5, "--frames", 3)
    assert result.exit_code == 0, result.output
    assert "60.0%" in result.stdout  # stills, by default
    left = run("stats", data, "--clips", 5, "--frames", 3, "--exclude", "stills")
    assert "100.0%" in left.stdout


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_stats_plots(data, suffix):
    pytest.importorskip("matplotlib", reason='needs matplotlib: pip install "re3[report]"')
    out = data / "plots" / f"stats.{suffix}"
    result = run("stats", data / "mix.yaml", "--clips", 6, "--frames", 4, "--out", out)
    assert result.exit_code == 0, result.output
    if suffix == "svg":
        text = out.read_text()
        for words in ("Sources", "Size of the object", "videos (recorded)", "stills (simulated)"):
            assert words in text
    else:
        assert cv2.imread(str(out)).shape[1] > 1000


def test_show_writes_a_sheet(data):
    out = data / "sheet.png"
    result = run("show", data / "mix.yaml", "--clips", 4, "--frames", 3, "--size", 64, "-o", out)
    assert result.exit_code == 0, result.output
    assert cv2.imread(str(out)).shape == (4 * (64 + 2 + 20), 3 * (64 + 2), 3)
    again = data / "again.png"
    run("show", data / "mix.yaml", "--clips", 4, "--frames", 3, "--size", 64, "-o", again)
    assert again.read_bytes() == out.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["stats", "{data}/gone"], "gone is not a folder"),
        (["stats", "{data}/gone.yaml"], "gone.yaml does not exist"),
        (["stats", "{data}/mix.yaml", "{data}/videos"], "is a mix; expected it alone"),
        (["stats", "{data}/mix.yaml", "--exclude", "x"], "says itself what is left out"),
        (["stats", "{data}", "--exclude", "x"], "no dataset ['x'] to leave out"),
        (["stats", "{data}", "--out", "{data}/a.gif"], "does not end in .svg, .pdf or .png"),
        (["show", "{data}", "--out", "{data}/a.gif"], "does not end in .png"),
        (["show", "{data}/broken.yaml", "--out", "{data}/a.png"], "unknown key 'source'"),
    ],
)
def test_what_is_wrong_is_told_without_a_traceback(data, arguments, told):
    (data / "broken.yaml").write_text("source: []")
    result = run(*(argument.format(data=data) for argument in arguments))
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_train_takes_a_mix_or_folders(data):
    sampler = _sampler([], set(), None, data / "mix.yaml")
    assert sampler.shares() == {("videos", "videos"): 0.5, ("stills", "stills"): 0.5}
    with pytest.raises(ValueError, match="expected --data with folders, or --mix with a file"):
        _sampler([], set(), None)
    for given in (([data], set(), None), ([], {"x"}, None), ([], set(), "otb")):
        with pytest.raises(ValueError, match="--mix says itself what is trained on"):
            _sampler(*given, data / "mix.yaml")


def test_the_cache_is_bounded_by_the_option(data):
    result = run("show", data / "videos", "--clips", 1, "-o", data / "a.png", "--cache-gb", 1e-6)
    # A folder of images is read one by one where there is no room for all.
    assert result.exit_code == 0, result.output
    assert not list((data.parent / "cache").rglob("*.npy"))


def test_help_has_examples():
    assert "re3 data stats mix.yaml" in run("stats", "--help").stdout
    assert "re3 data show mix.yaml" in run("show", "--help").stdout
    assert "--mix" in CliRunner().invoke(app, ["train", "--help"]).stdout
