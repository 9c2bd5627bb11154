import csv
import io
import json
from dataclasses import replace

import pytest

from re3.result import Result, Status
from re3.video import open_results

CAR = Result((1.5, 2.0, 30.25, 40.0), 0.91234, Status.TRACKED, 0, 1, "car")
DOG = Result((5.0, 6.0, 7.0, 8.0), 0.1, Status.LOST, 0, 2, "dog & cat")
PLAIN = Result((5.0, 6.0, 7.0, 8.0), float("nan"), Status.TRACKED, 0, 3)

ROW = {
    "frame": 7,
    "timestamp": 0.28,
    "object": "car",
    "x": 1.5,
    "y": 2.0,
    "w": 30.25,
    "h": 40.0,
    "score": 0.9123,
    "status": "tracked",
}


def write(path, *frames):
    with open_results(path) as writer:
        for index, results in enumerate(frames, start=7):
            writer.write(index, index * 0.04, results)
    return writer


def test_csv(tmp_path):
    path = tmp_path / "new" / "r.csv"
    assert write(path, [CAR, DOG], [PLAIN]).paths == [path]
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[0] == {name: str(value) for name, value in ROW.items()}
    assert [(row["frame"], row["object"], row["status"]) for row in rows] == [
        ("7", "car", "tracked"),
        ("7", "dog & cat", "lost"),
        ("8", "3", "tracked"),
    ]
    assert rows[2]["score"] == ""


def test_json_and_json_lines(tmp_path):
    write(tmp_path / "r.jsonl", [CAR], [DOG])
    write(tmp_path / "r.json", [CAR], [DOG])
    lines = [json.loads(line) for line in (tmp_path / "r.jsonl").read_text().splitlines()]
    assert lines[0] == ROW
    assert json.loads((tmp_path / "r.json").read_text()) == lines


def test_otb_text(tmp_path):
    path = tmp_path / "r.txt"
    assert write(path, [CAR], [CAR]).paths == [path]
    assert path.read_text() == "1.500,2.000,30.250,40.000\n" * 2


def test_otb_text_of_several_objects(tmp_path):
    written = write(tmp_path / "r.txt", [CAR, DOG], [CAR, DOG]).paths
    assert [path.name for path in written] == ["r-car.txt", "r-dog___cat.txt"]
    assert written[1].read_text() == "5.000,6.000,7.000,8.000\n" * 2
    assert sorted(tmp_path.iterdir()) == sorted(written)


def test_otb_text_of_objects_that_come_and_go_has_a_line_a_frame(tmp_path):
    write(tmp_path / "r.txt", [CAR], [CAR, DOG], [DOG])
    absent, car = "nan,nan,nan,nan", "1.500,2.000,30.250,40.000"
    assert (tmp_path / "r-car.txt").read_text().splitlines() == [car, car, absent]
    dog = (tmp_path / "r-dog___cat.txt").read_text().splitlines()
    assert dog == [absent, *["5.000,6.000,7.000,8.000"] * 2]


def test_otb_text_of_names_that_look_alike_in_a_file_name(tmp_path):
    alike = [replace(CAR, name=name) for name in ("a b", "a/b")]
    written = write(tmp_path / "r.txt", alike).paths
    assert [path.name for path in written] == ["r-a_b.txt", "r-a_b_.txt"]
    assert all(path.is_file() for path in written)


@pytest.mark.parametrize("name", ["r.csv", "r.txt"])
def test_two_objects_of_one_label_are_refused_and_leave_no_row(tmp_path, name):
    with open_results(tmp_path / name) as writer:
        writer.write(0, 0.0, [CAR])
        with pytest.raises(ValueError, match="frame 1 has objects of the same label: car, car"):
            writer.write(1, 0.04, [CAR, replace(CAR, object_id=2)])
    assert "1" not in [line.split(",")[0] for line in (tmp_path / name).read_text().splitlines()]


def test_json_of_frames_without_objects_is_json(tmp_path):
    write(tmp_path / "r.json", [], [])
    assert json.loads((tmp_path / "r.json").read_text()) == []


def test_motchallenge_text_is_1_based_and_numbers_objects_as_they_come(tmp_path):
    write(tmp_path / "r.mot.txt", [CAR], [], [PLAIN, CAR], [DOG])
    assert (tmp_path / "r.mot.txt").read_text().splitlines() == [
        "8,1,2.500,3.000,30.250,40.000,0.9123,-1,-1,-1",
        "10,2,6.000,7.000,7.000,8.000,1,-1,-1,-1",
        "10,1,2.500,3.000,30.250,40.000,0.9123,-1,-1,-1",
        "11,3,6.000,7.000,7.000,8.000,0.1,-1,-1,-1",
    ]


def test_coco_json(tmp_path):
    with open_results(tmp_path / "r.coco.json") as writer:
        writer.frame_size = (64, 48)
        writer.write(7, 0.28, [CAR, PLAIN])
        writer.write(8, 0.32, [])
        writer.write(9, 0.36, [CAR])
    whole = json.loads((tmp_path / "r.coco.json").read_text())
    assert whole["categories"] == [{"id": 1, "name": "car"}, {"id": 2, "name": "3"}]
    image = {"id": 8, "file_name": "000007.jpg", "width": 64, "height": 48, "frame": 7}
    assert whole["images"][0] == {**image, "timestamp": 0.28}
    assert [each["id"] for each in whole["images"]] == [8, 10]
    told = [(a["id"], a["image_id"], a["track_id"], a["score"]) for a in whole["annotations"]]
    assert told == [(1, 8, 1, 0.9123), (2, 8, 2, None), (3, 10, 1, 0.9123)]
    assert whole["annotations"][0]["bbox"] == [1.5, 2.0, 30.25, 40.0]
    assert whole["annotations"][0]["area"] == 30.25 * 40


def test_coco_json_has_names_and_sizes_of_images(tmp_path):
    with open_results(tmp_path / "r.coco.json") as writer:
        writer.frame_size = (64, 48)
        writer.write(0, 0.0, [CAR], image="a/shot_7.jpg")
        writer.write(1, 0.04, [CAR], image="a/shot_8.jpg", size=(32, 24), damaged=True)
    first, second = json.loads((tmp_path / "r.coco.json").read_text())["images"]
    assert (first["file_name"], first["width"], first["height"]) == ("a/shot_7.jpg", 64, 48)
    assert (second["file_name"], second["width"], second["height"]) == ("a/shot_8.jpg", 32, 24)
    assert "damaged" not in first
    assert second["damaged"] is True


def test_the_image_and_damage_of_a_frame_where_there_is_room(tmp_path):
    for name in ("r.csv", "r.jsonl", "r.json", "r.txt", "r.mot.txt"):
        with open_results(tmp_path / name) as writer:
            writer.extra_fields = ("image",)
            writer.write(7, 0.28, [CAR], image="shot, 7.jpg")
            writer.write(8, 0.32, [CAR], image="shot, 8.jpg", damaged=True)
    with (tmp_path / "r.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [*ROW, "image", "damaged"]
    told = [(row["image"], row["damaged"]) for row in rows]
    assert told == [("shot, 7.jpg", "0"), ("shot, 8.jpg", "1")]
    expected = [ROW | {"image": "shot, 7.jpg"}]
    expected.append(ROW | {"frame": 8, "timestamp": 0.32, "image": "shot, 8.jpg", "damaged": True})
    assert json.loads((tmp_path / "r.json").read_text()) == expected
    assert [json.loads(line) for line in (tmp_path / "r.jsonl").open()] == expected
    assert (tmp_path / "r.txt").read_text() == "1.500,2.000,30.250,40.000\n" * 2


@pytest.mark.parametrize("live", [False, True])
def test_csv_of_sound_frames_has_no_column_for_damage(tmp_path, live):
    path = tmp_path / "r.csv"
    with open_results(path, live=live) as writer:
        writer.write(0, 0.0, [CAR])
        writer.write(1, 0.1, [CAR, DOG], damaged=True)
        if live:
            assert path.read_text().startswith(",".join(ROW) + "\n")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["damaged"] for row in rows] == ["0", "1", "1"]
    assert list(tmp_path.iterdir()) == [path]
    with open_results(path, live=live) as writer:
        writer.write(0, 0.0, [CAR])
    assert path.read_text().splitlines()[0] == ",".join(ROW)


@pytest.mark.parametrize("name", ["r.csv", "r.jsonl", "r.txt", "r.mot.txt"])
def test_live_results_are_there_with_each_frame(tmp_path, name):
    whole = tmp_path / "whole"
    write(whole / name, [CAR], [CAR], [CAR])
    lines = (whole / name).read_text()
    path = tmp_path / name
    path.write_text("older")
    with open_results(path, live=True) as writer:
        assert path.read_text() == "older"
        for index in range(3):
            writer.write(index + 7, (index + 7) * 0.04, [CAR])
            found = path.read_text()
            assert lines.startswith(found)
            assert found.endswith("\n")
            assert len(found.splitlines()) == len(lines.splitlines()) - 2 + index
    assert path.read_text() == lines


def test_live_otb_text_of_several_objects(tmp_path):
    car, dog = tmp_path / "r-car.txt", tmp_path / "r-dog___cat.txt"
    box, absent = "1.500,2.000,30.250,40.000\n", "nan,nan,nan,nan\n"
    with open_results(tmp_path / "r.txt", live=True) as writer:
        writer.write(0, 0.0, [CAR])
        assert (tmp_path / "r.txt").read_text() == box
        writer.write(1, 0.0, [CAR, DOG])
        assert (car.read_text(), dog.read_text()) == (box * 2, absent + "5.000,6.000,7.000,8.000\n")
        writer.write(2, 0.0, [DOG])
        assert car.read_text() == box * 2 + absent
    assert sorted(tmp_path.iterdir()) == [car, dog]


@pytest.mark.parametrize("live", [False, True])
def test_a_disk_that_is_full_leaves_complete_lines(tmp_path, monkeypatch, live):
    path = tmp_path / "r.csv"
    with pytest.raises(OSError, match="full"), open_results(path, live=live) as writer:
        writer.write(0, 0.0, [CAR])

        class Full:
            """A file that takes ten bytes more."""

            def __init__(self, file):
                self.file, self.left = file, 10
                self.truncate, self.close = file.truncate, file.close

            def write(self, data):
                if not self.left:
                    raise OSError("disk full")
                written = self.file.write(data[: self.left])
                self.left = 0
                return written

        writer._file._file = Full(writer._file._file)
        writer.write(1, 0.04, [CAR])
    assert [line.split(",")[0] for line in path.read_text().split("\n")] == ["frame", "0", ""]


def test_an_older_file_stays_until_the_new_one_is_complete(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("older")
    with open_results(path):
        pass
    assert path.read_text() == "older"
    with open_results(path) as writer:
        writer.write(0, 0.0, [CAR])
        assert path.read_text() == "older"
    assert path.read_text().startswith("frame,")


def test_a_reader_of_standard_output_gets_each_frame_at_once(monkeypatch):
    class Pipe(io.StringIO):
        flushed = ""

        def flush(self):
            self.flushed = self.getvalue()

    pipe = Pipe()
    monkeypatch.setattr("sys.stdout", pipe)
    with open_results("-") as writer:
        for index in range(2):
            writer.write(index, 0.0, [CAR])
            assert len(pipe.flushed.splitlines()) == 2 + index


def test_standard_output_has_nothing_but_the_rows(capsys):
    write("-", [CAR])
    out, err = capsys.readouterr()
    assert out.splitlines() == [",".join(ROW), ",".join(str(v) for v in ROW.values())]
    assert err == ""


@pytest.mark.parametrize(
    "name", ["r.csv", "r.json", "r.jsonl", "r.txt", "r.mot.txt", "r.coco.json"]
)
def test_an_interrupted_run_keeps_what_it_had(tmp_path, name):
    path = tmp_path / name
    with pytest.raises(KeyboardInterrupt), open_results(path) as writer:
        writer.write(0, 0.0, [CAR])
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == [path]
    if name.endswith("json"):
        assert len(json.loads(path.read_text())) == (3 if "coco" in name else 1)


@pytest.mark.parametrize("name", ["r.csv", "r.json", "r.txt"])
def test_no_file_without_frames(tmp_path, name):
    with open_results(tmp_path / name):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["r.xml", "results"])
def test_an_unknown_ending_is_refused(tmp_path, name):
    with pytest.raises(ValueError, match=r"expected one of \.csv, \.txt, \.json, \.jsonl, "):
        open_results(tmp_path / name)


def test_a_folder_is_refused(tmp_path):
    (tmp_path / "r.csv").mkdir()
    with pytest.raises(ValueError, match="is a folder"):
        open_results(tmp_path / "r.csv")
