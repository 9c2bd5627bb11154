import layouts
import numpy as np
import pytest

from re3.data.formats import find_format, read_dataset


def test_frames_with_nothing_to_see_get_no_box(tmp_path):
    (cat,) = read_dataset(layouts.lasot(tmp_path / "LaSOT"))
    np.testing.assert_array_equal(cat.boxes_xywh, [[0, 1, 3, 4], layouts.NAN, layouts.NAN])
    assert cat.occluded.tolist() == [False, True, False]
    assert (cat.name, cat.label, cat.dataset) == ("cat-1", "cat", "LaSOT")
    assert cat.source == tmp_path / "LaSOT" / "cat" / "cat-1" / "img"


def test_sequences_may_lie_directly_in_the_folder(tmp_path):
    layouts.lasot(tmp_path / "whole")
    flat = tmp_path / "whole" / "cat"
    assert find_format(flat).name == "lasot"
    assert [s.name for s in read_dataset(flat)] == ["cat-1"]


def test_a_slip_of_the_annotation_is_a_gap(tmp_path):
    folder = layouts.lasot(tmp_path) / "cat" / "cat-1"
    layouts.text(folder / "full_occlusion.txt", "0,0,0")
    layouts.text(folder / "out_of_view.txt", "0,0,0")
    layouts.text(folder / "groundtruth.txt", "1,1,0,0", "5,5,2,2", "613,731,247,-11")
    (cat,) = read_dataset(tmp_path)
    assert cat.annotated.tolist() == [False, True, False]


def test_broken_sequences_name_the_file(tmp_path):
    folder = layouts.lasot(tmp_path) / "cat" / "cat-1"
    layouts.text(folder / "out_of_view.txt", "0,0")
    with pytest.raises(ValueError, match=r"out_of_view\.txt marks 2 frames; expected 3"):
        read_dataset(tmp_path)
    (folder / "out_of_view.txt").unlink()
    with pytest.raises(FileNotFoundError, match=r"out_of_view\.txt does not exist; expected 0 or"):
        read_dataset(tmp_path)
    (folder / "img" / "00000003.jpg").unlink()
    with pytest.raises(ValueError, match=r"groundtruth\.txt has 3 lines, but .*img 2 images"):
        read_dataset(tmp_path)
    (folder / "groundtruth.txt").unlink()
    with pytest.raises(FileNotFoundError, match=r"groundtruth\.txt does not exist"):
        read_dataset(tmp_path, "lasot")
