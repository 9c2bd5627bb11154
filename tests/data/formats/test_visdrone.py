import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset


def test_several_objects_and_one(tmp_path):
    third, tenth, single = read_dataset(layouts.visdrone(tmp_path / "VisDrone"))
    assert (third.name, third.label, third.dataset) == ("uav1_v/3", "car", "VisDrone2019-MOT-val")
    # Frames are 1-based, boxes are not; the third frame is missing. Score 0 and ignored regions
    # are left out.
    np.testing.assert_array_equal(
        third.boxes_xywh, [[0, 3, 4, 5], [1, 3, 4, 5], layouts.NAN, [3, 3, 4, 5]]
    )
    assert third.occluded.tolist() == [False, True, False, False]
    assert (tenth.name, tenth.label, tenth.start_frame) == ("uav1_v/10", "motor", 1)
    assert (single.name, single.dataset) == ("uav2_s", "VisDrone2019-SOT-val")
    np.testing.assert_array_equal(single.boxes_xywh, [[1, 2, 3, 4], [2, 2, 3, 4], layouts.NAN])


def test_a_part_is_a_dataset_as_well(tmp_path):
    part = layouts.visdrone(tmp_path / "VisDrone") / "VisDrone2019-SOT-val"
    assert [s.name for s in read_dataset(part)] == ["uav2_s"]


def test_a_test_part_gives_the_first_box_alone(tmp_path):
    part = layouts.visdrone(tmp_path) / "VisDrone2019-SOT-val"
    layouts.text(part / "annotations" / "uav2_s.txt", "1,2,3,4")
    (sequence,) = read_dataset(part)
    assert sequence.annotated.tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["5,1,1,1,2,2,1,4,0,0"], "line 1: frame 5; expected 1 to 4"),
        (["1,1,1,1,2,2,1,4,0"], "line 1: 9 numbers"),
        (["1,1,1,1,2,2,1,4,0,0"] * 2, "line 2: id 1 comes twice in frame 1"),
        (["1,1,1,1,2,2,1,4,0,x"], "line 1: .* is not numbers"),
    ],
)
def test_broken_lines_are_told(tmp_path, lines, told):
    part = layouts.visdrone(tmp_path) / "VisDrone2019-MOT-val"
    layouts.text(part / "annotations" / "uav1_v.txt", *lines)
    with pytest.raises(ValueError, match=rf"uav1_v\.txt, {told}"):
        read_dataset(part)
