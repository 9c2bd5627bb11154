import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset
from re3.data.formats.vot import parse_region


@pytest.mark.parametrize(
    ("line", "box"),
    [
        ("1,2,3,4", [1, 2, 3, 4]),  # a box
        ("1.5,2,7,2,7,9.5,1.5,9.5", [1.5, 2, 5.5, 7.5]),  # an upright polygon
        ("5,0,10,5,5,10,0,5", [0, 0, 10, 10]),  # a rotated one: the outermost box
        ("0,0,4,0,2,6", [0, 0, 4, 6]),  # a triangle
        ("m3,4,5,2,1,2,3,1,3", [4, 4, 2, 2]),  # .##.. above .#... at (3, 4)
        ("m3,4,5,2,0,1,8,1", [3, 4, 5, 2]),  # the first and the last of its pixels
        ("m3,4,5,2,6,1", [4, 5, 1, 1]),  # zeros at the end left out
        ("m0,0,3,2,6", layouts.NAN),  # a mask without a pixel
        ("m7,8,0,0,0", layouts.NAN),  # an empty region
        ("nan,nan,nan,nan", layouts.NAN),  # absent, as in the long-term challenge
        ("0", layouts.NAN),  # a special code
    ],
)
def test_regions(line, box):
    np.testing.assert_array_equal(parse_region(line, "here"), box)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("1,2,3", "here: 3 numbers; expected x,y,width,height"),
        ("1,2,3,4,5,6,7", "here: 7 numbers"),
        ("a,b,c,d", "here: 'a,b,c,d' is not numbers"),
        ("", "here: 0 numbers"),
        ("m1,2,3", "here: not a mask"),
        ("m1,2,2.5,2,1", "here: not a mask"),
        ("m1,2,2,2,3,4", "here: the mask's runs are 7 pixels long; expected at most 2 x 2"),
    ],
)
def test_what_is_no_region_is_told(line, told):
    with pytest.raises(ValueError, match=told):
        parse_region(line, "here")


def test_the_list_gives_the_sequences_and_their_order(tmp_path):
    folder = layouts.vot(tmp_path / "vot2018")
    # In older years images lie beside the truth.
    layouts.images(folder / "ants", 2, digits=8)
    layouts.text(folder / "ants" / "groundtruth.txt", "5,0,10,5,5,10,0,5", "nan,nan,nan,nan")
    layouts.text(folder / "list.txt", "ball", "ants", "")
    ball, ants = read_dataset(folder)
    assert (ball.name, ball.source) == ("ball", folder / "ball" / "color")
    assert (ants.name, ants.source) == ("ants", folder / "ants")
    np.testing.assert_array_equal(ball.boxes_xywh[0], [1, 2, 3, 4])  # as it stands, 0-based
    np.testing.assert_array_equal(ants.boxes_xywh, [[0, 0, 10, 10], layouts.NAN])
    assert {ball.dataset, ants.dataset} == {"vot2018"}
    (folder / "list.txt").unlink()
    assert [s.name for s in read_dataset(folder)] == ["ants", "ball"]


@pytest.mark.parametrize("suffix", [".tag", ".label"])
def test_marks_of_frames(tmp_path, suffix):
    folder = layouts.vot(tmp_path) / "ball"
    layouts.text(folder / f"occlusion{suffix}", "0", "1")  # ends early: not marked from there on
    layouts.text(folder / f"camera_motion{suffix}", "1", "1", "1")
    layouts.text(folder / f"size_change{suffix}", "0", "0", "0")
    (ball,) = read_dataset(tmp_path)
    assert ball.occluded.tolist() == [False, True, False]
    assert ball.attributes == ("camera motion", "occlusion")


def test_broken_sequences_name_the_file(tmp_path):
    folder = layouts.vot(tmp_path) / "ball"
    layouts.text(folder / "occlusion.tag", *"0000")
    with pytest.raises(ValueError, match=r"occlusion\.tag marks 4 frames; expected 3"):
        read_dataset(tmp_path)
    layouts.text(folder / "occlusion.tag", "0", "2", "0")
    with pytest.raises(ValueError, match=r"occlusion\.tag, line 2: '2'; expected 0 or 1"):
        read_dataset(tmp_path)
    (folder / "occlusion.tag").unlink()
    layouts.text(folder / "groundtruth.txt", "1,2,3,4", "1,2")
    with pytest.raises(ValueError, match=r"groundtruth\.txt, line 2: 2 numbers"):
        read_dataset(tmp_path)
    layouts.text(folder / "groundtruth.txt", *layouts.boxes(4))
    with pytest.raises(ValueError, match=r"groundtruth\.txt has 4 lines, but .*color 3 images"):
        read_dataset(tmp_path)
    (folder / "groundtruth.txt").write_text("\n")
    with pytest.raises(ValueError, match=r"groundtruth\.txt is empty"):
        read_dataset(tmp_path)
    layouts.text(tmp_path / "list.txt", "gone")
    layouts.text(folder / "groundtruth.txt", *layouts.boxes(3))
    with pytest.raises(FileNotFoundError, match="gone does not exist; expected a folder of images"):
        read_dataset(tmp_path)
