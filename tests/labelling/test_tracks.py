"""The folder of labelled tracks, and the videos that it is made of."""

from fractions import Fraction

import numpy as np
import pytest
import stub_trackers as stubs

from re3.data.plain import read_folder
from re3.labelling.config import LabelConfig
from re3.labelling.tracks import LOG, TrackFolder, find_videos, given_boxes, settings_of
from re3.labelling.videos import LabelledTrack

SETTINGS = settings_of(LabelConfig(), "fear-xs", "re3-lite", False)


def track(first=120, count=5):
    boxes = np.array([stubs.square(t) for t in range(count)])
    return LabelledTrack(stubs.footage(count), boxes, first, 0.8)


def test_tracks_are_read_as_training_reads_them(tmp_path):
    TrackFolder(tmp_path, SETTINGS).write("day/street", [track(), track(400)], Fraction(15))
    first, second = read_folder(tmp_path)
    assert [first.name, second.name] == ["street-000120-0", "street-000400-1"]
    np.testing.assert_allclose(first.boxes_xywh, track().boxes_xywh)
    assert len(list(second.frames())) == 5
    assert not [p for p in tmp_path.rglob("*") if p.suffix == ".partial"]


def test_a_folder_goes_on_where_it_stopped(tmp_path):
    TrackFolder(tmp_path, SETTINGS).write("a", [track()], Fraction(15))
    again = TrackFolder(tmp_path, SETTINGS)
    again.write("b", [], Fraction(15))
    third = TrackFolder(tmp_path, SETTINGS)
    assert (third.tracks_of("a"), third.tracks_of("b"), third.tracks_of("c")) == (1, 0, None)


def test_a_video_whose_tracks_cannot_be_written_is_not_done(tmp_path):
    folder = TrackFolder(tmp_path, SETTINGS)
    (tmp_path / "a-000120-0.mp4").mkdir()
    with pytest.raises((ValueError, OSError)):
        folder.write("a", [track()], Fraction(15))
    assert TrackFolder(tmp_path, SETTINGS).tracks_of("a") is None


def test_other_settings_are_refused(tmp_path):
    TrackFolder(tmp_path, SETTINGS).write("a", [], Fraction(15))
    other = settings_of(LabelConfig(threshold=0.7), "fear-xs", "re3-base", False)
    with pytest.raises(
        ValueError, match=r"another second \(re3-lite, now re3-base\), threshold \(0.6, now 0.7\)"
    ):
        TrackFolder(tmp_path, other)


@pytest.mark.parametrize("text", ["", "no json\n", "[]\n", "{}\n", '{"settings": {}}\n{"a": 1}\n'])
def test_a_broken_log_is_refused(tmp_path, text):
    (tmp_path / LOG).write_text(text)
    with pytest.raises(ValueError, match=r"labelled\.jsonl is not the log"):
        TrackFolder(tmp_path, SETTINGS)


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def test_folders_are_searched_in_natural_order(tmp_path):
    touch(tmp_path, "in/b10.mp4", "in/b9.MOV", "in/c/a.gif", "in/notes.txt", "one.mkv")
    found = find_videos([tmp_path / "in", tmp_path / "one.mkv"], tmp_path / "out")
    assert list(found) == ["b9", "b10", "c/a", "one"]
    assert found["c/a"] == tmp_path / "in" / "c" / "a.gif"


@pytest.mark.parametrize(
    ("paths", "out", "error", "message"),
    [
        (["nowhere"], "out", FileNotFoundError, "nowhere does not exist"),
        (["in/notes.txt"], "out", ValueError, r"notes\.txt is not a video.*\.mp4"),
        (["empty"], "out", ValueError, "empty is not a video and holds none"),
        (["in"], "in/tracks", ValueError, "tracks is inside of"),
        (["in"], "in", ValueError, "is inside of"),
        (["in", "other/a.avi"], "out", ValueError, r"a\.mp4 and .*a\.avi would both give"),
    ],
)
def test_what_cannot_be_labelled_is_refused(tmp_path, paths, out, error, message):
    touch(tmp_path, "in/a.mp4", "in/notes.txt", "other/a.avi")
    (tmp_path / "empty").mkdir()
    with pytest.raises(error, match=message):
        find_videos([tmp_path / path for path in paths], tmp_path / out)


def test_given_boxes_lie_beside_the_video(tmp_path):
    touch(tmp_path, "a.mp4", "b.mp4")
    (tmp_path / "a.txt").write_text("1,2,30,40\n")
    (sequence,) = given_boxes(tmp_path / "a.mp4")
    assert sequence.boxes_xywh.tolist() == [[1, 2, 30, 40]]
    with pytest.raises(ValueError, match=r"neither b\.txt nor b\.jsonl"):
        given_boxes(tmp_path / "b.mp4")
