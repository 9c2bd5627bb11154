import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset


def sequence(folder, name, images, rows, truth="groundtruth_rect.txt", separator=","):
    layouts.images(folder / name / "img", images)
    layouts.text(folder / name / truth, *layouts.boxes(rows, separator))
    return folder


@pytest.mark.parametrize("separator", [",", "\t", " ", ", "])
def test_boxes_are_made_0_based(tmp_path, separator):
    (bolt,) = read_dataset(sequence(tmp_path / "OTB", "Bolt", 3, 3, separator=separator))
    np.testing.assert_array_equal(bolt.boxes_xywh, [[0, 1, 3, 4], [1, 1, 3, 4], [2, 1, 3, 4]])
    assert (bolt.name, bolt.dataset, bolt.start_frame) == ("Bolt", "OTB", 0)
    assert bolt.source == tmp_path / "OTB" / "Bolt" / "img"
    assert (bolt.occluded, bolt.attributes) == (None, ())


@pytest.mark.parametrize(
    ("name", "images", "rows", "start", "first_box_x", "length"),
    [
        ("David", 770, 471, 299, 0, 471),  # the truth has the range alone
        ("David", 770, 770, 299, 299, 471),  # the truth has every frame
        ("David", 471, 471, 0, 0, 471),  # a copy cut before
        ("Tiger1", 354, 354, 5, 5, 349),
        ("Tiger1", 354, 349, 5, 0, 349),
        ("Football1", 81, 74, 0, 0, 74),
        ("Freeman4", 297, 297, 0, 0, 283),
        ("Diving", 231, 215, 0, 0, 215),
        ("freeman3", 474, 460, 0, 0, 460),  # however it is spelt
    ],
)
def test_the_part_the_benchmark_uses(tmp_path, name, images, rows, start, first_box_x, length):
    folder = tmp_path / name / "img"
    folder.mkdir(parents=True)
    for index in range(images):
        (folder / f"{index + 1:04d}.jpg").touch()
    layouts.text(tmp_path / name / "groundtruth_rect.txt", *layouts.boxes(rows))
    (found,) = read_dataset(tmp_path)
    assert (found.start_frame, len(found)) == (start, length)
    assert found.boxes_xywh[0, 0] == first_box_x


def test_two_targets_become_two_sequences(tmp_path):
    sequence(tmp_path, "Jogging", 3, 3, "groundtruth_rect.1.txt")
    layouts.text(tmp_path / "Jogging" / "groundtruth_rect.2.txt", *["9,9,2,2"] * 3)
    sequence(tmp_path, "Human4", 2, 2, "groundtruth_rect.2.txt")
    (tmp_path / "Human4" / "groundtruth_rect1.txt").touch()
    found = read_dataset(tmp_path)
    assert [s.name for s in found] == ["Human4-2", "Jogging-1", "Jogging-2"]
    assert found[1].source == found[2].source
    assert found[2].boxes_xywh[0].tolist() == [8, 8, 2, 2]


def test_images_need_not_begin_at_1_and_a_box_without_area_is_a_gap(tmp_path):
    layouts.images(tmp_path / "BlurCar1" / "img", 3, first=247)
    layouts.text(tmp_path / "BlurCar1" / "groundtruth_rect.txt", *layouts.boxes(2), "0,0,0,0")
    (found,) = read_dataset(tmp_path)
    assert (found.start_frame, found.annotated.tolist()) == (0, [True, True, False])


@pytest.mark.parametrize(
    ("file", "content", "attributes"),
    [
        (
            "attrs.txt",
            "IV, OPR, LR",
            ("illumination variation", "out-of-plane rotation", "low resolution"),
        ),
        ("attrs.txt", "1,0,0,1,0,0,0,0,0,0,0", ("illumination variation", "occlusion")),
        ("attrs.txt", "FM new", ("fast motion", "new")),
        ("cfg.json", '{"name": "Bolt", "attributes": ["BC"]}', ("background clutter",)),
        ("cfg.json", "{}", ()),
    ],
)
def test_attributes(tmp_path, file, content, attributes):
    layouts.text(layouts.otb(tmp_path) / "Bolt" / file, content)
    (bolt,) = read_dataset(tmp_path)
    assert bolt.attributes == attributes


def test_broken_sequences_name_the_file(tmp_path):
    layouts.otb(tmp_path)
    path = tmp_path / "Bolt" / "groundtruth_rect.txt"
    layouts.text(path, *layouts.boxes(2))
    with pytest.raises(ValueError, match=r"rect\.txt has 2 lines, but .*img 3 images"):
        read_dataset(tmp_path)
    layouts.text(path, "1,2,3,4", "1,2,3", "1,2,3,4")
    with pytest.raises(ValueError, match=r"rect\.txt, line 2: 3 numbers"):
        read_dataset(tmp_path)
    layouts.text(path, *layouts.boxes(3))
    layouts.text(tmp_path / "Bolt" / "attrs.txt", "1,0,1")
    with pytest.raises(ValueError, match=r"attrs\.txt has 3 marks; expected 11"):
        read_dataset(tmp_path)
    (tmp_path / "Bolt" / "attrs.txt").unlink()
    layouts.text(tmp_path / "Bolt" / "cfg.json", "[1]")
    with pytest.raises(ValueError, match=r"cfg\.json: .*expected a JSON object"):
        read_dataset(tmp_path)
    (tmp_path / "Bolt" / "cfg.json").unlink()
    layouts.images(tmp_path / "Car" / "img", 1)
    with pytest.raises(FileNotFoundError, match=r"Car has no groundtruth_rect\.txt"):
        read_dataset(tmp_path)
    layouts.text(tmp_path / "Car" / "groundtruth_rect.txt", *layouts.boxes(1))
    (tmp_path / "Car" / "img" / "0001.jpg").unlink()
    with pytest.raises(FileNotFoundError, match="img holds no image"):
        read_dataset(tmp_path)
