"""`re3 data label` from outside, with stub trackers."""

import json

import pytest
import stub_trackers as stubs
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.data.plain import read_folder
from re3.evaluation.peers import find_tracker
from re3.labelling import videos as labelling
from re3.video.writer import VideoWriter

BRIGHT = ("--teacher", "python:stub_trackers:Bright", "--second", "python:stub_trackers:Bright")


def run(*arguments):
    return CliRunner().invoke(app, ["data", "label", *map(str, arguments)])


def words(text):
    return " ".join(text.split())


@pytest.fixture
def clips(tmp_path):
    folder = tmp_path / "clips"
    for name in ("a", "b"):
        with VideoWriter(folder / f"{name}.mp4", 15, (160, 96)) as video:
            for frame in stubs.footage():
                video.write(frame)
    return folder


def annotate(folder, name):
    boxes = (",".join(map(str, stubs.square(t))) for t in range(40))
    (folder / f"{name}.txt").write_text("".join(f"{box}\n" for box in boxes))


def test_videos_become_tracks_and_a_second_run_goes_on(clips, tmp_path):
    out = tmp_path / "tracks"
    first = run(clips, "--out", out, *BRIGHT)
    assert first.exit_code == 0, first.output
    assert "2 tracks of 2 videos; 0 could not be read" in words(first.stdout)
    assert [len(sequence) for sequence in read_folder(out)] == [40, 40]
    again = run(clips, "--out", out, *BRIGHT)
    assert words(again.stdout).count("labelled before") == 2


def test_a_video_that_cannot_be_read_is_listed_and_the_rest_labelled(clips, tmp_path):
    (clips / "a.mp4").write_text("no video")
    result = run(clips, "--out", tmp_path / "tracks", *BRIGHT, "--json")
    assert result.exit_code == 1
    broken, good = json.loads(result.stdout)["videos"]
    assert "cannot be opened" in broken["error"] and good["tracks"] == 1


def test_given_boxes_are_followed(clips, tmp_path):
    (clips / "a.txt").write_text("10,30,24,24\n")
    result = run(clips / "a.mp4", "--out", tmp_path / "tracks", "--given", *BRIGHT)
    assert result.exit_code == 0, result.output
    (sequence,) = read_folder(tmp_path / "tracks")
    assert len(sequence) == 40


def test_an_interrupted_run_keeps_what_is_done(clips, tmp_path, monkeypatch):
    out, real = tmp_path / "tracks", labelling.label_video

    def interrupted(video, *arguments):
        if video.stem == "b":
            raise KeyboardInterrupt
        return real(video, *arguments)

    monkeypatch.setattr(labelling, "label_video", interrupted)
    result = run(clips, "--out", out, *BRIGHT)
    assert result.exit_code == 130 and "the same command goes on" in result.output
    monkeypatch.undo()
    again = run(clips, "--out", out, *BRIGHT)
    assert words(again.stdout).count("labelled before") == 1 and "2 tracks" in words(again.stdout)


def test_the_check_prints_how_accurate_kept_boxes_are(clips):
    annotate(clips, "a")
    result = run(clips, "--check", *BRIGHT)
    assert result.exit_code == 0, result.output
    # The middle is one of 40 frames; compression moves edges by less than a pixel.
    assert "0.6 1 100.0% 100.0% 100.0%" in words(result.stdout)
    table = json.loads(run(clips, "--check", *BRIGHT, "--json", "--threshold", 0.65).stdout)
    assert table["clips"] == 1
    assert 0.65 in [row["threshold"] for row in table["thresholds"]]
    assert list(clips.glob("*.jsonl")) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no folder for the tracks; give one with --out"),
        (["--check", "--out", "x"], "--check writes no tracks; leave out --out"),
        (["--out", "x", "--sequences", "a"], "give it with --check only"),
        (["--out", "x", "--threshold", 60], "threshold is 60.0"),
        (["--out", "x", "--given"], "no boxes given for"),
        (["--out", "x", "--teacher", "nobody"], "nobody"),
        (["--check"], "no annotated clip"),
    ],
)
def test_what_cannot_be_done_is_refused(clips, monkeypatch, tmp_path, arguments, message):
    monkeypatch.chdir(tmp_path)
    result = run(clips, *BRIGHT, *arguments)
    assert result.exit_code == 2, result.output
    assert message in words(result.output)
    assert not (tmp_path / "x").exists()


def test_a_check_without_a_clip_that_is_long_enough_says_so(clips):
    annotate(clips, "a")
    result = run(clips, "--check", *BRIGHT, "--shortest", 41)
    assert result.exit_code == 2 and "none of the 1 clips has 41 frames" in words(result.output)


def test_fear_xs_labels_the_drawn_clip(clips, tmp_path, shared_data):
    peers = shared_data.parent / "peers"
    try:
        find_tracker("fear-xs", peers)
    except (ValueError, OSError) as error:
        pytest.skip(f"needs the files of FEAR-XS: {error}")
    result = run(clips / "a.mp4", "--out", tmp_path / "tracks", "--peers", peers)
    assert result.exit_code == 0, result.output
