"""A workspace on disk, and what the toolkit leaves in it, without the toolkit."""

import configparser
import json
import shlex

import cv2
import numpy as np
import pytest

from re3.data.plain import read_folder, read_track
from re3.data.sequence import Sequence
from re3.evaluation.supervised import Step
from re3.evaluation.vot import STACKS, VotStack
from re3.evaluation.vot_results import read_analysis, read_runs
from re3.evaluation.vot_toolkit import ToolkitError, run_toolkit
from re3.evaluation.vot_workspace import write_config, write_sequences, write_trackers


@pytest.fixture
def patch(clips):
    return read_track(clips / "patch")


def test_sequences_are_written_as_the_toolkit_reads_them(patch, tmp_path):
    counted = []
    named = write_sequences(tmp_path, [patch], counted.append)
    assert list(named) == ["patch"]
    assert counted == [*range(1, 13), 12]
    folder = tmp_path / "sequences" / "patch"
    assert (tmp_path / "sequences" / "list.txt").read_text() == "patch\n"
    assert set((folder / "sequence").read_text().split()) == {
        "name=patch",
        "channels.color=color/%08d.png",
        "fps=30",
        "length=12",
        "width=160",
        "height=120",
    }
    assert (folder / "groundtruth.txt").read_text().splitlines()[:2] == [
        "30,20,40,32",
        "33,22,40,32",
    ]
    names = sorted(path.name for path in (folder / "color").iterdir())
    assert names == [f"{number:08d}.png" for number in range(1, 13)]
    for name, frame in zip(names, patch.frames(), strict=True):
        np.testing.assert_array_equal(cv2.imread(str(folder / "color" / name)), frame)


def test_sequences_that_are_there_are_left_alone(patch, tmp_path):
    write_sequences(tmp_path, [patch])
    image = tmp_path / "sequences" / "patch" / "color" / "00000001.png"
    before = image.stat().st_mtime_ns
    write_sequences(tmp_path, [patch])
    assert image.stat().st_mtime_ns == before
    moved = Sequence(patch.name, patch.source, patch.boxes_xywh + 1)
    with pytest.raises(ValueError, match=r"holds another sequence.*give another --workspace"):
        write_sequences(tmp_path, [moved])


def test_one_that_was_interrupted_is_written_again(patch, tmp_path):
    write_sequences(tmp_path, [patch])
    folder = tmp_path / "sequences" / "patch"
    (folder / "sequence").unlink()
    (folder / "color" / "00000005.png").write_bytes(b"torn")
    write_sequences(tmp_path, [patch])
    assert cv2.imread(str(folder / "color" / "00000005.png")).shape == (120, 160, 3)
    assert (folder / "sequence").is_file()


def test_names_become_folders_of_their_own(patch, tmp_path):
    def named(name, dataset):
        return Sequence(name, patch.source, patch.boxes_xywh, dataset=dataset)

    written = write_sequences(tmp_path, [named("a/1", "x"), named("a,b", "x")])
    assert list(written) == ["a-1", "a-b"]
    written = write_sequences(tmp_path, [named("dog", "x"), named("dog", "y")])
    assert list(written) == ["x-dog", "y-dog"]
    with pytest.raises(ValueError, match="two sequences are called 'x-dog'"):
        write_sequences(tmp_path, [named("dog", "x"), named("dog", "x")])
    with pytest.raises(ValueError, match="no sequences"):
        write_sequences(tmp_path, [])


def test_a_frame_without_box_is_refused(clips, tmp_path):
    late = next(s for s in read_folder(clips) if s.name == "patch-late")
    with pytest.raises(ValueError, match="'patch-late' has no box in 2 of its 12 frames"):
        write_sequences(tmp_path, [late])


def test_config_names_the_stack_or_a_file(tmp_path):
    write_config(tmp_path, STACKS["vot2016"])
    assert "stack: vot2016/rgb\n" in (tmp_path / "config.yaml").read_text()
    assert not (tmp_path / "stack.yaml").exists()
    write_config(tmp_path, VotStack("vot2014", "vot2014", (5, 30), repetitions=2))
    assert "stack: ./stack.yaml\n" in (tmp_path / "config.yaml").read_text()
    lines = [line.strip() for line in (tmp_path / "stack.yaml").read_text().splitlines()]
    for line in ("repetitions: 2", "skip_initialize: 5", "burnin: 10", "low: 5", "high: 30"):
        assert line in lines


def test_trackers_are_entered_beside_those_there(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", "src")
    monkeypatch.chdir(tmp_path)
    model = tmp_path / "50%.v2.onnx"
    model.touch()
    assert write_trackers(tmp_path, [("kcf", "kcf")]) == {"kcf": "kcf"}
    assert write_trackers(tmp_path, [("50%.v2", model.name)]) == {"50__v2": "50%.v2"}
    # As the toolkit reads it.
    registry = configparser.ConfigParser()
    registry.read(tmp_path / "trackers.ini")
    assert registry.sections() == ["kcf", "50__v2"]
    entry = registry["50__v2"]
    assert entry["label"] == "50%.v2"
    assert entry["protocol"] == "trax"
    server = ["-m", "re3.apps.trax_server", "--tracker", model.name, "--directory", str(tmp_path)]
    assert shlex.split(entry["command"])[1:] == server
    assert entry["env_pythonpath"] == str(tmp_path / "src")
    with pytest.raises(ValueError, match=r"'a\.b' and 'a_b' are both 'a_b'"):
        write_trackers(tmp_path, [("a.b", "kcf"), ("a_b", "kcf")])


def test_trajectories_are_read(patch, tmp_path):
    write_sequences(tmp_path, [patch])
    folder = tmp_path / "results" / "kcf" / "baseline" / "patch"
    folder.mkdir(parents=True)
    lines = ["1", "33.5,22.0,40.0,32.0", "2", "0", "0", "0", "0", "1", *["1.0,2.0,3.0,4.0"] * 4]
    for number in (1, 2, 3):
        (folder / f"patch_{number:03d}.txt").write_text("\n".join(lines) + "\n")
    (folder / "patch_001_time.value").write_text("0.5\n" * 12)
    (runs,) = read_runs(tmp_path, "kcf", ["patch"], 2)
    assert len(runs.runs) == 2
    assert runs.size == (160, 120)
    np.testing.assert_array_equal(runs.truth_xywh, patch.boxes_xywh)
    track = runs.runs[0]
    s, f, x, gap = Step.STARTED, Step.FOLLOWED, Step.FAILED, Step.SKIPPED
    assert track.steps.tolist() == [s, f, x, gap, gap, gap, gap, s, f, f, f, f]
    assert track.boxes_xywh[1].tolist() == [33.5, 22, 40, 32]
    assert track.boxes_xywh[7].tolist() == patch.boxes_xywh[7].tolist()
    assert np.isnan(track.boxes_xywh[2:7]).all()
    with pytest.raises(FileNotFoundError, match="run without --no-run"):
        read_runs(tmp_path, "csrt", ["patch"], 2)
    (folder / "patch_001.txt").write_text("1\n")
    with pytest.raises(ValueError, match="1 lines, but the sequence 12 frames"):
        read_runs(tmp_path, "kcf", ["patch"], 2)
    (folder / "patch_001.txt").write_text("1\n" + "1,2,3,4,5,6\n" * 11)
    with pytest.raises(ValueError, match=r"line 2: '1,2,3,4,5,6' is neither a rectangle"):
        read_runs(tmp_path, "kcf", ["patch"], 2)


def test_an_analysis_of_something_else_is_refused(tmp_path):
    path = tmp_path / "a.json"
    for text in ("{}", "[]", "no json", json.dumps({"results": {"baseline": {}}})):
        path.write_text(text)
        with pytest.raises(ValueError, match="is not the analysis of kcf in vot2016"):
            read_analysis(path, ["kcf"], STACKS["vot2016"])


def test_a_toolkit_that_fails_is_told_with_its_last_lines(tmp_path):
    # It is missing here, or meets a folder that is no workspace.
    log = tmp_path / "log.txt"
    with pytest.raises(ToolkitError, match=r"`vot analysis kcf` failed.*log\.txt: .*\w"):
        run_toolkit("analysis", "kcf", workspace=tmp_path, log=log)
    assert log.read_text().startswith("$ vot analysis kcf\n")
