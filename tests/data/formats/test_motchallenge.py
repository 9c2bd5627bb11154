import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset


def test_a_sequence_an_id_that_counts(tmp_path):
    third, tenth = read_dataset(layouts.motchallenge(tmp_path / "MOT16"))
    assert (third.name, third.label) == ("MOT16-02/3", "person")
    assert (tenth.name, tenth.label) == ("MOT16-02/10", "static person")
    assert third.dataset == "MOT16-train"
    # 1-based boxes and frames; the third frame is missing.
    np.testing.assert_array_equal(
        third.boxes_xywh, [[1, 2, 4, 5], [2, 2, 4, 5], layouts.NAN, [4, 2, 4, 5]]
    )
    assert third.occluded.tolist() == [False, True, False, False]
    assert (tenth.start_frame, tenth.occluded.tolist()) == (1, [True])
    assert third.source == tmp_path / "MOT16/train/MOT16-02/img1"


def test_mot15_says_nothing_of_class_and_occlusion(tmp_path):
    layouts.images(tmp_path / "ADL-Rundle-6" / "img1", 2, digits=6)
    layouts.text(
        tmp_path / "ADL-Rundle-6" / "gt" / "gt.txt",
        "2,1,7,3,4,5,1,-1,-1,-1",
        "1,1,6.5,3,4,5,1,3.2,1.5,0",
    )
    (found,) = read_dataset(tmp_path)
    assert (found.name, found.label, found.occluded) == ("ADL-Rundle-6/1", "person", None)
    assert found.boxes_xywh.tolist() == [[5.5, 2, 4, 5], [6, 2, 4, 5]]


def test_sequences_without_truth_are_left_out(tmp_path):
    layouts.motchallenge(tmp_path)
    layouts.images(tmp_path / "test" / "MOT16-01" / "img1", 2, digits=6)
    assert {s.name.partition("/")[0] for s in read_dataset(tmp_path)} == {"MOT16-02"}


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["5,1,1,1,2,2,1,1,1"], "line 1: frame 5; expected 1 to 4"),
        (["0,1,1,1,2,2,1,1,1"], "line 1: frame 0; expected 1 to 4"),
        (["1,1,1,1,2,2"], "line 1: 6 numbers"),
        (["1,1,1,1,2,2,1,1,x"], "line 1: .* is not numbers"),
        (["1,1,1,1,nan,2,1,1,1"], "line 1: 9 numbers in '1,1,1,1,nan,2,1,1,1'"),
        (["1,1,1,1,2,2,1,1,1"] * 2, "line 2: id 1 comes twice in frame 1"),
    ],
)
def test_broken_lines_are_told(tmp_path, lines, told):
    layouts.text(layouts.motchallenge(tmp_path) / "train/MOT16-02/gt/gt.txt", *lines)
    with pytest.raises(ValueError, match=rf"gt\.txt, {told}"):
        read_dataset(tmp_path)


def test_the_number_of_images_is_checked(tmp_path):
    folder = layouts.motchallenge(tmp_path) / "train" / "MOT16-02"
    layouts.images(folder / "img1", 5, digits=6)
    with pytest.raises(ValueError, match=r"seqinfo\.ini says that there are 4 frames, but .* 5"):
        read_dataset(tmp_path)
    layouts.text(folder / "seqinfo.ini", "no section")
    with pytest.raises(ValueError, match=r"seqinfo\.ini: .*expected \[Sequence\]"):
        read_dataset(tmp_path)
