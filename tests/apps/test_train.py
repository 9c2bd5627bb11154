"""What `re3 train` finds to train on."""

import cv2
import numpy as np
import pytest

from re3.apps.train import _sampler


def clip(folder, name, truth):
    """Three pictures of 64 x 48 pixels in a folder, and a text of boxes somewhere."""
    folder.joinpath(name).mkdir(parents=True)
    for index in range(3):
        picture = np.zeros((48, 64, 3), np.uint8)
        cv2.imwrite(str(folder / name / f"{index:04d}.png"), picture)
    truth.write_text("5,6,20,10\n" * 3)


def still(folder):
    folder.mkdir(parents=True)
    cv2.imwrite(str(folder / "a.png"), np.zeros((48, 64, 3), np.uint8))
    box = '{"label": "dog", "box_xywh": [5, 6, 20, 20]}'
    (folder / "boxes.jsonl").write_text(
        f'{{"image": "a.png", "mask": null, "width": 64, "height": 48, "objects": [{box}]}}\n'
    )


@pytest.fixture
def data(tmp_path):
    """Plain clips, a dataset in OTB's layout and stills, one beside the other."""
    folder = tmp_path / "data"
    clip(folder / "sets" / "mine", "duck", folder / "sets" / "mine" / "duck.txt")
    bolt = folder / "sets" / "OTB" / "Bolt"
    clip(bolt, "img", bolt / "groundtruth_rect.txt")
    still(folder / "stills")
    return folder


def found(sampler):
    return {(s.dataset, s.name): s.boxes_xywh[0].tolist() for s in sampler.sequences}


def test_datasets_of_all_formats_and_stills_are_found(data):
    sampler = _sampler([data], set(), None)
    # OTB counts pixels from 1.
    assert found(sampler) == {("OTB", "Bolt"): [4, 5, 20, 10], ("mine", "duck"): [5, 6, 20, 10]}
    assert len(sampler.stills) == 1


def test_the_format_may_be_named_and_datasets_left_out(data):
    assert found(_sampler([data], set(), "otb")) == {("OTB", "Bolt"): [4, 5, 20, 10]}
    assert list(found(_sampler([data], {"OTB"}, None))) == [("mine", "duck")]


@pytest.mark.parametrize(
    ("folder", "exclude", "told"),
    [
        ("gone", set(), "gone is not a folder; expected clips or stills in it"),
        ("sets/mine/duck", set(), "holds no annotated clip"),
        (".", {"got10k"}, r"no dataset \['got10k'\] to leave out; there are \['OTB', 'mine'\]"),
    ],
)
def test_what_is_not_there_is_told(data, folder, exclude, told):
    with pytest.raises(ValueError, match=told):
        _sampler([data / folder], exclude, None)
