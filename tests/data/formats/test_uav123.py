import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset


def frames(folder, count):
    """Empty files: the reader does not open them."""
    folder.mkdir(parents=True)
    for index in range(count):
        (folder / f"{index + 1:06d}.jpg").touch()


def by_name(folder):
    return {sequence.name: sequence for sequence in read_dataset(folder)}


def test_boxes_are_made_0_based_and_absence_stays(tmp_path):
    layouts.uav123(tmp_path)
    layouts.text(tmp_path / "anno/UAV123/bike1.txt", "1,2,3,4", "NaN,NaN,NaN,NaN", "3,2,3,4")
    (bike,) = read_dataset(tmp_path)
    np.testing.assert_array_equal(bike.boxes_xywh, [[0, 1, 3, 4], layouts.NAN, [2, 1, 3, 4]])
    assert (bike.name, bike.dataset, bike.start_frame) == ("bike1", "UAV123", 0)
    assert bike.source == tmp_path / "data_seq/UAV123/bike1"


def test_parts_share_a_folder_and_a_frame(tmp_path):
    frames(tmp_path / "data_seq/UAV123/group1", 9)
    frames(tmp_path / "data_seq/UAV123/car1_s", 2)
    for name, rows in (("group1_1", 4), ("group1_2", 3), ("group1_3", 4), ("car1_s", 2)):
        layouts.text(tmp_path / f"anno/UAV123/{name}.txt", *layouts.boxes(rows))
    found = by_name(tmp_path)
    assert {name: s.start_frame for name, s in found.items()} == {
        "car1_s": 0,  # a folder of its own
        "group1_1": 0,
        "group1_2": 3,  # frame 4 of the folder is in both
        "group1_3": 5,
    }
    assert found["group1_3"].source.name == "group1"
    assert found["group1_3"].start_frame + len(found["group1_3"]) == 9


@pytest.mark.parametrize(
    ("set_name", "images", "rows", "starts"),
    [
        # configSeqs of the benchmark: frames 1-253, 775-1477, 1573-2437.
        ("UAV123", 2437, (253, 703, 865), (0, 774, 1572)),
        ("UAV123_10fps", 813, (85, 235, 289), (0, 258, 524)),  # every third of them
    ],
)
def test_parts_that_follow_a_gap(tmp_path, set_name, images, rows, starts):
    frames(tmp_path / "data_seq" / set_name / "bird1", images)
    for number, count in enumerate(rows, start=1):
        layouts.text(tmp_path / "anno" / set_name / f"bird1_{number}.txt", *layouts.boxes(count))
    found = read_dataset(tmp_path)
    assert tuple(s.start_frame for s in found) == starts
    assert found[-1].start_frame + len(found[-1]) == images


def test_every_set_is_read_and_uav20l_has_its_images_in_uav123(tmp_path):
    layouts.uav123(tmp_path)
    layouts.text(tmp_path / "anno/UAV20L/bike1.txt", *layouts.boxes(3))
    found = read_dataset(tmp_path)
    assert [(s.dataset, s.name) for s in found] == [("UAV20L", "bike1"), ("UAV123", "bike1")]
    assert found[0].source == found[1].source


def test_attributes(tmp_path):
    layouts.text(layouts.uav123(tmp_path) / "anno/UAV123/att/bike1.txt", "1,0,0,0,0,1,0,0,0,0,0,1")
    (bike,) = read_dataset(tmp_path)
    assert bike.attributes == ("scale variation", "partial occlusion", "similar object")


def test_broken_sequences_name_the_file(tmp_path):
    layouts.uav123(tmp_path)
    text = tmp_path / "anno/UAV123/bike1.txt"
    layouts.text(text.parent / "att/bike1.txt", "1,0,1")
    with pytest.raises(ValueError, match=r"att.bike1\.txt: .*expected 12 zeros and ones"):
        read_dataset(tmp_path)
    (text.parent / "att/bike1.txt").unlink()
    layouts.text(text, *layouts.boxes(4))
    with pytest.raises(ValueError, match=r"bike1\.txt has 4 lines from frame 1 .* 3 images"):
        read_dataset(tmp_path)
    layouts.text(text, *layouts.boxes(3))
    layouts.text(text.with_name("car9.txt"), *layouts.boxes(3))
    with pytest.raises(FileNotFoundError, match=r"car9 does not exist; expected the images of"):
        read_dataset(tmp_path)
    text.with_name("car9.txt").unlink()
    layouts.text(text.with_name("bike1_2.txt"), *layouts.boxes(2))
    with pytest.raises(FileNotFoundError, match=r"bike1_1\.txt does not exist"):
        read_dataset(tmp_path)
