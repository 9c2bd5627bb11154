import json
from pathlib import Path

import numpy as np
import pytest

from re3.data.plain import (
    read_boxes,
    read_folder,
    read_track,
    read_tracks,
)
from re3.result import Result, Status
from re3.video.results import open_results

NAN = [np.nan] * 4


def clip(folder: Path, name: str = "clip.mp4") -> Path:
    """An empty file: readers of annotations do not open the video."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def frame_line(frame, *objects) -> str:
    items = [{"id": i, "label": label, "box_xywh": box} for i, label, box in objects]
    return json.dumps({"frame": frame, "objects": items})


@pytest.mark.parametrize(
    ("text", "boxes"),
    [
        ("1,2,3,4\n5,6,7,8\n", [[1, 2, 3, 4], [5, 6, 7, 8]]),  # commas
        ("1\t2\t3\t4\n", [[1, 2, 3, 4]]),  # tabs
        ("1 2  3 4", [[1, 2, 3, 4]]),  # spaces, no last newline
        (" 1, 2, 3, 4 \r\n", [[1, 2, 3, 4]]),  # both, Windows line ends
        ("\ufeff1,2,3,4\n", [[1, 2, 3, 4]]),  # byte order mark
        ("-1.5,2e1,3,4\n\n\n", [[-1.5, 20, 3, 4]]),  # signs, exponents, empty lines at the end
        ("1,2,3,4\nnan,nan,nan,nan\n", [[1, 2, 3, 4], NAN]),  # absent
        ("1,2,3,4\nNaN NaN NaN NaN\n", [[1, 2, 3, 4], NAN]),  # absent, MATLAB's spelling
        ("1,2,3,4\n0,0,0,0\n", [[1, 2, 3, 4], NAN]),  # absent, a box without area
    ],
)
def test_one_object(tmp_path, text, boxes):
    video = clip(tmp_path / "pool")
    video.with_suffix(".txt").write_text(text, encoding="utf-8", newline="")
    sequence = read_track(video)
    np.testing.assert_array_equal(sequence.boxes_xywh, boxes)
    assert (sequence.name, sequence.dataset) == ("clip", "pool")
    assert (sequence.source, sequence.start_frame, sequence.label) == (video, 0, None)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("1,2,3,4\n1,2,3\n", "line 2: 3 numbers"),  # a number short
        ("1,2,3,4,5,6,7,8\n", "line 1: 8 numbers"),  # a polygon
        ("x,y,w,h\n1,2,3,4\n", "line 1: 'x,y,w,h' is not four numbers"),  # a heading
        ("1,2,3,4\n\n1,2,3,4\n", "line 2: 0 numbers"),  # an empty line in between
        ("1,2,nan,4\n", "line 1: '1,2,nan,4' is not finite"),  # half absent
        ("1,2,inf,4\n", "line 1: '1,2,inf,4' is not finite"),
        ("1,2,3,4\n1,2,-3,4\n", "line 2: box 1, 2, -3, 4 .*negative size"),
        ("nan,nan,nan,nan\n", "no line has a box"),  # nothing to start with
    ],
)
def test_what_is_not_an_annotation_names_file_and_line(tmp_path, text, told):
    video = clip(tmp_path)
    video.with_suffix(".txt").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=rf"clip\.txt.*{told}"):
        read_track(video)


def test_binary_annotation_is_told(tmp_path):
    video = clip(tmp_path)
    video.with_suffix(".txt").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ValueError, match=r"clip\.txt is not UTF-8"):
        read_track(video)


def test_missing_files_are_told(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"clip\.mp4 does not exist"):
        read_track(tmp_path / "clip.mp4")
    with pytest.raises(FileNotFoundError, match=r"clip\.txt does not exist"):
        read_track(clip(tmp_path))


def test_boxes_of_a_result_are_read_as_written(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("1,2,0,0\n1,2,-3,4\nnan,nan,nan,nan\n")
    np.testing.assert_array_equal(read_boxes(path), [[1, 2, 0, 0], [1, 2, -3, 4], NAN])


def test_several_objects(tmp_path):
    video = clip(tmp_path / "street")
    video.with_suffix(".jsonl").write_text(
        "\n".join(
            [
                frame_line(0, (10, "car", [1, 1, 2, 2])),
                frame_line(1),
                frame_line(2, (10, "car", [3, 1, 2, 2]), (2, None, [7, 7, 1, 1])),
                frame_line(3, (2, "dog", [8, 7, 1, 1])),
                frame_line(4, (5, "ghost", [8, 7, 0, 0])),  # never has an area
                "",
            ]
        )
    )
    second, tenth = read_tracks(video)
    # Natural order: 2 before 10; from an object's first frame to its last.
    assert (second.name, second.label, second.start_frame) == ("clip/2", "dog", 2)
    np.testing.assert_array_equal(second.boxes_xywh, [[7, 7, 1, 1], [8, 7, 1, 1]])
    assert (tenth.name, tenth.label, tenth.start_frame) == ("clip/10", "car", 0)
    np.testing.assert_array_equal(tenth.boxes_xywh, [[1, 1, 2, 2], NAN, [3, 1, 2, 2]])
    assert {second.dataset, tenth.dataset} == {"street"}
    assert {second.source, tenth.source} == {video}


GOOD = frame_line(0, (1, "dog", [1, 2, 3, 4]))


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("{", "not JSON"),
        ("[]", "no list of objects"),
        ('{"frame": 1}', "no list of objects"),
        ('{"frame": -1, "objects": []}', "frame is -1"),
        ('{"frame": "1", "objects": []}', "frame is '1'"),
        ('{"frame": true, "objects": []}', "frame is True"),
        ('{"frame": 0, "objects": []}', "frame 0 comes twice"),
        ('{"frame": 1, "objects": [5]}', "object 5 has no id"),
        ('{"frame": 1, "objects": [{"box_xywh": [1, 2, 3, 4]}]}', "has no id"),
        ('{"frame": 1, "objects": [{"id": 1}]}', "box None of object 1"),
        ('{"frame": 1, "objects": [{"id": 1, "box_xywh": [1, 2, 3]}]}', r"box \[1, 2, 3\]"),
        ('{"frame": 1, "objects": [{"id": 1, "box_xywh": [1, 2, "a", 4]}]}', "not four numbers"),
        ('{"frame": 1, "objects": [{"id": 1, "box_xywh": [1, 2, -3, 4]}]}', "negative size"),
        ('{"frame": 1, "objects": [{"id": 1, "box_xywh": [NaN, 2, 3, 4]}]}', "not finite"),
        (frame_line(1, (1, "a", [1, 1, 1, 1]), (1, "a", [1, 1, 1, 1])), "'1' comes twice"),
    ],
)
def test_what_is_not_a_frame_of_objects_names_file_and_line(tmp_path, line, told):
    video = clip(tmp_path)
    video.with_suffix(".jsonl").write_text(f"{GOOD}\n{line}\n")
    with pytest.raises(ValueError, match=rf"clip\.jsonl, line 2: .*{told}"):
        read_tracks(video)


def test_no_object_at_all_is_told(tmp_path):
    video = clip(tmp_path)
    video.with_suffix(".jsonl").write_text(frame_line(0) + "\n")
    with pytest.raises(ValueError, match=r"clip\.jsonl: no frame has an object"):
        read_tracks(video)


def test_a_folder_is_read_with_all_below_in_natural_order(tmp_path):
    for name in ("b/clip10.mp4", "b/clip2.MKV", "b/clip.mp4", "a/one.avi"):
        path = clip(tmp_path, name)
        path.with_suffix(".txt").write_text("1,2,3,4\n")
    many = clip(tmp_path, "b/many.mp4")
    many.with_suffix(".jsonl").write_text(GOOD + "\n")
    clip(tmp_path, "b/unlabelled.mp4")
    (tmp_path / "b" / "notes.txt").write_text("not boxes, and beside no clip\n")
    clip(tmp_path, "c/frames/0001.jpg")
    (tmp_path / "c" / "frames.txt").write_text("1,2,3,4\n")
    clip(tmp_path, "d/Bird2/img/0001.jpg")
    (tmp_path / "d/Bird2/groundtruth_rect.txt").write_text("1\t2\t3\t4\n")

    sequences = read_folder(tmp_path)
    assert [(s.dataset, s.name) for s in sequences] == [
        ("a", "one"),
        ("b", "clip"),
        ("b", "clip2"),
        ("b", "clip10"),
        ("b", "many/1"),
        ("c", "frames"),
        ("d", "Bird2"),
    ]
    assert sequences[5].source == tmp_path / "c/frames"
    assert sequences[6].source == tmp_path / "d/Bird2/img"


def test_a_folder_that_is_itself_a_clip(tmp_path):
    clip(tmp_path, "set/Bird2/0001.png")
    (tmp_path / "set/Bird2/groundtruth_rect.txt").write_text("1,2,3,4\n")
    (sequence,) = read_folder(tmp_path / "set/Bird2")
    assert (sequence.dataset, sequence.name) == ("set", "Bird2")
    assert sequence.source == tmp_path / "set/Bird2"


def row(frame, name, box, status="tracked", **more) -> str:
    x, y, w, h = box
    record = {
        "frame": frame,
        "timestamp": frame / 30,
        "object": name,
        "x": x,
        "y": y,
        "w": w,
        "h": h,
    }
    return json.dumps({**record, "score": 0.9, "status": status, **more})


def test_rows_of_re3_track_are_read(tmp_path):
    video = clip(tmp_path / "pool")
    lines = [
        row(3, "dog", [1, 2, 3, 4]),
        row(3, "car", [5, 6, 7, 8]),
        row(4, "dog", [2, 2, 3, 4], "uncertain"),
        row(4, "car", [6, 6, 7, 8], "lost", image="0005.jpg"),
        row(5, "dog", [3, 2, 3, 4]),
        row(5, "car", [7, 6, 7, 8], score=None),
    ]
    video.with_suffix(".jsonl").write_text("\ufeff" + "\n".join(lines) + "\n", encoding="utf-8")
    car, dog = read_tracks(video)
    assert (car.name, car.start_frame, car.label) == ("clip/car", 3, None)
    np.testing.assert_array_equal(car.boxes_xywh, [[5, 6, 7, 8], NAN, [7, 6, 7, 8]])
    np.testing.assert_array_equal(dog.boxes_xywh, [[1, 2, 3, 4], [2, 2, 3, 4], [3, 2, 3, 4]])


def test_what_the_writer_of_results_writes_is_read(tmp_path):
    video = clip(tmp_path)
    given = [(2.5, 3.25, 10, 20), (3, 4, 11, 21), (4, 5, 12, 22)]
    with open_results(tmp_path / "clip.jsonl") as results:
        for frame, box in enumerate(given):
            results.write(frame, frame / 30, [Result(box, 0.9, Status.TRACKED, 1, "dog")])
    (sequence,) = read_folder(tmp_path)
    np.testing.assert_array_equal(sequence.boxes_xywh, given)
    assert (sequence.name, sequence.source) == ("clip/dog", video)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (row(1, "dog", [1, 2, -3, 4]), "negative size"),
        (row(1, "dog", [1, 2, 3, None]), "expected"),
        (row(0, "dog", [1, 2, 3, 4]), "object 'dog' comes twice in frame 0"),
        (row(-1, "dog", [1, 2, 3, 4]), "frame is -1"),
        (row(1, ["dog"], [1, 2, 3, 4]), "object is"),
        (frame_line(1, ("dog", "dog", [1, 2, 3, 4])), "is not a row of results"),
        ('{"frame": 1, "object": "dog"}', "no number 'x'"),
        ('{"frame": 1, ', "not JSON"),
    ],
)
def test_broken_rows_name_file_and_line(tmp_path, line, told):
    video = clip(tmp_path)
    video.with_suffix(".jsonl").write_text(row(0, "dog", [1, 2, 3, 4]) + "\n" + line + "\n")
    with pytest.raises(ValueError, match=rf"clip\.jsonl, line 2: .*{told}"):
        read_tracks(video)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("-1,-1,-1,-1\n", r"line 1: .*where the object is absent, write nan,nan,nan,nan"),
        ("0,0,-1,0\n", r"line 1: .*write nan,nan,nan,nan"),
        ("1,1,5,5,10,10,1,-1,-1,-1\n", r"line 1: 10 numbers .*MOTChallenge"),
        ("frame,timestamp,object,x,y,w,h,score,status\n", r"line 1: .*a table with a header"),
    ],
)
def test_what_others_write_in_place_of_a_box_is_named(tmp_path, text, told):
    video = clip(tmp_path)
    video.with_suffix(".txt").write_text(text)
    with pytest.raises(ValueError, match=told):
        read_track(video)


def test_folders_without_clips_are_told(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere does not exist"):
        read_folder(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="holds no annotated clip"):
        read_folder(tmp_path)
    with pytest.raises(NotADirectoryError, match="is not a folder"):
        read_folder(clip(tmp_path))


def test_real_clips(shared_data):
    davis = read_folder(shared_data / "val" / "davis")
    assert [s.name for s in davis][:3] == ["blackswan", "bmx-trees", "breakdance"]
    assert len(davis) == 20
    assert davis[0].boxes_xywh[1].tolist() == [129.0, 70.0, 383.0, 312.0]
    tracks = read_folder(shared_data / "val" / "mot")
    assert all(s.annotated[0] and s.annotated[-1] for s in tracks)
    assert {s.label for s in tracks} == {"person"}
