import layouts
import numpy as np
import pytest

from re3.data.formats import find_format, read_dataset

META = """[METAINFO]
url: https://example.org/watch?v=%41
begin: 00:00:34
object_class: arctic fox
motion_class: bite"""


def test_boxes_absence_cover_and_class(tmp_path):
    folder = layouts.got10k(tmp_path / "GOT-10k") / "val" / "GOT-10k_Val_000001"
    layouts.images(folder, 5, digits=8)
    layouts.text(folder / "groundtruth.txt", *layouts.boxes(3), "0,0,0,0", "9.5000,1,2,2")
    layouts.text(folder / "absence.label", "0", "1", "0", "0", "0")
    layouts.text(folder / "cover.label", "8", "0", "5", "4", "1")
    # Written on Windows, with a byte order mark.
    (folder / "meta_info.ini").write_text(META, encoding="utf-8-sig")
    (found,) = read_dataset(tmp_path / "GOT-10k")
    expected = [[0, 1, 3, 4], layouts.NAN, [2, 1, 3, 4], layouts.NAN, [8.5, 0, 2, 2]]
    np.testing.assert_array_equal(found.boxes_xywh, expected)
    # At most 60 % visible.
    assert found.occluded.tolist() == [False, True, False, True, True]
    assert (found.name, found.dataset) == ("GOT-10k_Val_000001", "GOT-10k-val")
    assert (found.label, found.source, found.start_frame) == ("arctic fox", folder, 0)


def test_a_part_alone_is_a_dataset(tmp_path):
    folder = layouts.got10k(tmp_path / "GOT-10k") / "val"
    (found,) = read_dataset(folder)
    assert (found.dataset, found.label, found.occluded) == ("GOT-10k-val", None, None)


def test_a_test_sequence_has_the_first_box_alone(tmp_path):
    layouts.images(tmp_path / "test" / "GOT-10k_Test_000001", 3, digits=8)
    layouts.text(tmp_path / "test" / "GOT-10k_Test_000001" / "groundtruth.txt", "1,2,3,4")
    layouts.text(tmp_path / "test" / "list.txt", "GOT-10k_Test_000001")
    assert find_format(tmp_path).name == "got10k"
    (found,) = read_dataset(tmp_path)
    assert found.annotated.tolist() == [True, False, False]


def test_broken_sequences_name_the_file(tmp_path):
    folder = layouts.got10k(tmp_path) / "val" / "GOT-10k_Val_000001"
    layouts.text(folder / "cover.label", "8", "9", "8")
    with pytest.raises(ValueError, match=r"cover\.label, line 2: '9'; expected a level from 0"):
        read_dataset(tmp_path)
    layouts.text(folder / "cover.label", "8")
    with pytest.raises(ValueError, match=r"cover\.label has 1 levels; expected 3"):
        read_dataset(tmp_path)
    (folder / "cover.label").unlink()
    layouts.text(folder / "meta_info.ini", "no section")
    with pytest.raises(
        ValueError, match=r"meta_info\.ini: .*expected \[METAINFO\] with object_class"
    ):
        read_dataset(tmp_path)
    (folder / "meta_info.ini").unlink()
    layouts.text(folder / "absence.label", "0", "0")
    with pytest.raises(ValueError, match=r"absence\.label marks 2 frames; expected 3"):
        read_dataset(tmp_path)
    # With labels a single box is a broken truth, not a test sequence.
    layouts.text(folder / "groundtruth.txt", "1,2,3,4")
    with pytest.raises(ValueError, match=r"groundtruth\.txt has 1 lines, but .* 3 images"):
        read_dataset(tmp_path)
    layouts.text(tmp_path / "val" / "list.txt", "GOT-10k_Val_000001", "GOT-10k_Val_000002")
    layouts.text(folder / "groundtruth.txt", *layouts.boxes(3))
    layouts.text(folder / "absence.label", *"000")
    with pytest.raises(FileNotFoundError, match="000002 does not exist"):
        read_dataset(tmp_path)
