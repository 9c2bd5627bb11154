import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset

CLIP = "VID/train/ILSVRC2015_VID_train_0000/ILSVRC2015_train_00000000"


def test_a_sequence_a_track(tmp_path):
    dog, cat = read_dataset(layouts.imagenet_vid(tmp_path / "ILSVRC2015"))
    assert (dog.name, cat.name) == ("ILSVRC2015_train_00000000/0", "ILSVRC2015_train_00000000/1")
    assert (dog.label, cat.label) == ("dog", "domestic cat")
    assert dog.dataset == "ILSVRC2015-train"
    # Corners are inclusive; NaN where the dog is gone.
    np.testing.assert_array_equal(
        dog.boxes_xywh, [[2, 3, 8, 5], [3, 3, 8, 5], layouts.NAN, [5, 3, 8, 5]]
    )
    assert dog.occluded.tolist() == [False, True, False, False]
    # Frame 1 alone, and the whole picture.
    assert (cat.start_frame, cat.boxes_xywh.tolist()) == (1, [[0, 0, 32, 24]])
    assert dog.source == cat.source == tmp_path / "ILSVRC2015" / "Data" / CLIP


def test_generated_boxes_can_be_left_out(tmp_path):
    dog, _ = read_dataset(layouts.imagenet_vid(tmp_path), "imagenet-vid-drawn")
    assert dog.annotated.tolist() == [True, False, False, True]
    assert not dog.occluded.any()


def test_validation_videos_lie_one_level_higher_and_one_track_needs_no_number(tmp_path):
    layouts.images(tmp_path / "Data/VID/val/v_1", 1, first=0, digits=6, suffix=".JPEG")
    xml = tmp_path / "Annotations/VID/val/v_1/000000.xml"
    layouts.vid_xml(xml, ("4", "n00000000", (1, 1, 2, 2), 0, 0))
    (found,) = read_dataset(tmp_path)
    assert (found.name, found.label) == ("v_1", "n00000000")
    assert found.dataset == f"{tmp_path.name}-val"


def test_broken_annotations_name_the_file(tmp_path):
    folder = layouts.imagenet_vid(tmp_path) / "Annotations" / CLIP
    xml = folder / "000002.xml"
    one = ("0", "n02084071", (1, 1, 2, 2), 0, 0)
    layouts.vid_xml(xml, one, one)
    with pytest.raises(ValueError, match=r"000002\.xml: track 0 comes twice"):
        read_dataset(tmp_path)
    layouts.text(xml, "<annotation><object><name>n1</name></object></annotation>")
    with pytest.raises(ValueError, match=r"000002\.xml: an object has no bndbox/xmin; expected"):
        read_dataset(tmp_path)
    layouts.text(xml, "<annotation>")
    with pytest.raises(ValueError, match=r"000002\.xml: .*; expected <object> with trackid"):
        read_dataset(tmp_path)
    layouts.vid_xml(xml, ("0", "n1", ("left", 1, 2, 2), 0, 0))
    with pytest.raises(ValueError, match=r"000002\.xml: could not convert"):
        read_dataset(tmp_path)
    xml.rename(folder / "000007.xml")
    with pytest.raises(ValueError, match=r"000007\.xml: .* has no image 000007"):
        read_dataset(tmp_path)
    (folder / "000007.xml").unlink()
    with pytest.raises(ValueError, match=r"has 3 \.xml files, but .* 4 images"):
        read_dataset(tmp_path)
