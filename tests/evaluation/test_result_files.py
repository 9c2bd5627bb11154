from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from re3.data.sequence import Sequence
from re3.evaluation.one_pass import Track
from re3.evaluation.result_files import load_track, result_path, save_track

NAN = (np.nan,) * 4
BOX = (1.0, 2.0, 3.0, 4.0)
finite = st.floats(-1e6, 1e6)


def track_of(boxes, failure=None) -> Track:
    count = len(boxes)
    return Track(np.array(boxes, float), np.full(count, 0.5), np.full(count, 0.01), failure)


@given(st.lists(st.tuples(finite, finite, finite, finite, st.floats(0, 1), st.floats(0, 9))))
def test_what_is_saved_reads_back_bit_for_bit(tmp_path_factory, rows):
    table = np.array([(*BOX, 1.0, 0.25), *rows])
    sequence = Sequence("clip", Path("clip.mp4"), np.tile(BOX, (len(table), 1)))
    path = tmp_path_factory.mktemp("results") / "a" / "clip.txt"
    save_track(path, Track(table[:, :4], table[:, 4], table[:, 5]))
    track = load_track(path, sequence)
    np.testing.assert_array_equal(track.boxes_xywh, table[:, :4])
    np.testing.assert_array_equal(track.scores, table[:, 4])
    np.testing.assert_array_equal(track.seconds, table[:, 5])


def test_the_form_is_plain_text(tmp_path, sequence_of):
    save_track(tmp_path / "clip.txt", track_of([BOX, (0.1, -2, 3.25, 40)]))
    assert (tmp_path / "clip.txt").read_text() == "1,2,3,4\n0.1,-2,3.25,40\n"
    assert (tmp_path / "clip.csv").read_text() == "score,seconds\n0.5,0.01\n0.5,0.01\n"


@pytest.mark.parametrize(
    ("dataset", "tracker", "name", "path"),
    [
        ("davis", "kcf", "bear", "davis/kcf/bear.txt"),
        ("mot15", "kcf", "ADL-6/3", "mot15/kcf/ADL-6/3.txt"),  # a track of many
        ("davis", "kcf", "v1.5", "davis/kcf/v1.5.txt"),  # a dot is no suffix
        ("", "kcf", "bear", "sequences/kcf/bear.txt"),  # no dataset
    ],
)
def test_where_results_belong(sequence_of, dataset, tracker, name, path):
    sequence = sequence_of([BOX], name=name, dataset=dataset)
    assert result_path(Path("out"), tracker, sequence) == Path("out") / path


@pytest.mark.parametrize(
    ("dataset", "tracker", "name"),
    [
        ("davis", "kcf", "../../bear"),  # out of the folder
        ("davis", "kcf", "/bear"),
        ("davis", "..", "bear"),
        ("davis", "a/b", "bear"),
        ("davis", "", "bear"),
        ("..", "kcf", "bear"),
        ("davis", "kcf", "a\\b"),  # a folder on Windows
    ],
)
def test_names_that_lead_elsewhere_are_refused(sequence_of, dataset, tracker, name):
    with pytest.raises(ValueError, match="do not make a path"):
        result_path(Path("out"), tracker, sequence_of([BOX], name=name, dataset=dataset))


@pytest.mark.parametrize(
    "boxes",
    [
        [BOX, NAN, NAN],  # a tracker that failed
        [BOX, NAN, BOX],  # a hole
    ],
)
def test_tracks_with_holes_are_not_complete(tmp_path, sequence_of, boxes):
    save_track(tmp_path / "clip.txt", track_of(boxes))
    assert load_track(tmp_path / "clip.txt", sequence_of([BOX] * 3)) is None


def test_files_that_are_not_there_are_not_complete(tmp_path, sequence_of):
    path = tmp_path / "clip.txt"
    assert load_track(path, sequence_of([BOX])) is None
    save_track(path, track_of([BOX]))
    path.with_suffix(".csv").unlink()
    assert load_track(path, sequence_of([BOX])) is None


def test_frames_before_the_start_may_be_without_boxes(tmp_path, sequence_of):
    save_track(tmp_path / "clip.txt", track_of([NAN, BOX, BOX]))
    assert load_track(tmp_path / "clip.txt", sequence_of([NAN, BOX, NAN])) is not None


@pytest.mark.parametrize(
    ("truth", "told"),
    [
        ([BOX] * 3, "2 boxes.*has 3 frames"),  # another length
        ([(9, 9, 9, 9)] * 2, r"starts at box \[1.0.*at \[9.0"),  # another object
    ],
)
def test_results_of_another_clip_are_refused(tmp_path, sequence_of, truth, told):
    save_track(tmp_path / "clip.txt", track_of([BOX] * 2))
    with pytest.raises(ValueError, match=told):
        load_track(tmp_path / "clip.txt", sequence_of(truth))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("score,seconds\n1,x\n", "could not convert"),
        ("seconds,score\n1,1\n", "does not have the columns"),
        ("score,seconds\n1,2,3\n", "does not have the columns"),
    ],
)
def test_spoilt_times_are_told(tmp_path, sequence_of, text, told):
    path = tmp_path / "clip.txt"
    save_track(path, track_of([BOX]))
    path.with_suffix(".csv").write_text(text)
    with pytest.raises(ValueError, match=rf"clip\.csv.*{told}"):
        load_track(path, sequence_of([BOX]))
