"""The registry: which format a folder looks like, and what every reader keeps to."""

import layouts
import numpy as np
import pytest

from re3.data.formats import FORMATS, find_format, read_dataset
from re3.data.plain import read_folder

DERIVED = {
    "alov-interpolated": "alov",
    "imagenet-vid-drawn": "imagenet-vid",
    "davis-merged": "davis",
}


@pytest.mark.parametrize("name", layouts.BUILDERS)
def test_a_folder_is_recognised_by_its_structure(tmp_path, name):
    folder = layouts.BUILDERS[name](tmp_path / "data")
    assert find_format(folder).name == name
    # Plain takes OTB's folders as well, which is why it comes last.
    others = [f.name for f in FORMATS if f.automatic and f.detect(folder) and f.name != name]
    assert others == (["plain"] if name == "otb" else [])


@pytest.mark.parametrize("name", layouts.BUILDERS)
def test_sequences_can_be_played(tmp_path, name):
    sequences = read_dataset(layouts.BUILDERS[name](tmp_path / "data"))
    assert sequences
    for sequence in sequences:
        assert len(list(sequence.frames())) == len(sequence)
        assert sequence.annotated.any()
        assert sequence.dataset
        assert "/" not in sequence.dataset


@pytest.mark.parametrize(("name", "base"), DERIVED.items())
def test_variants_of_a_format_have_to_be_asked_for(tmp_path, name, base):
    folder = layouts.BUILDERS[base](tmp_path / "data")
    assert find_format(folder).name == base
    assert find_format(folder, name).name == name
    assert {f.name for f in FORMATS if not f.automatic} == set(DERIVED)


@pytest.mark.parametrize("name", ["otb", "vot", "got10k", "lasot", "motchallenge", "trackingnet"])
def test_a_folder_inside_is_a_dataset_as_well(tmp_path, name):
    folder = layouts.BUILDERS[name](tmp_path / "data")
    inner = {
        "otb": "Bolt",
        "vot": "ball",
        "got10k": "val/GOT-10k_Val_000001",
        "lasot": "cat/cat-1",
        "motchallenge": "train/MOT16-02",
        "trackingnet": "TRAIN_0",
    }[name]
    whole, part = read_dataset(folder), read_dataset(folder / inner)
    assert find_format(folder / inner).name == name
    assert [s.name for s in part] == [s.name for s in whole]
    for one, other in zip(part, whole, strict=True):
        np.testing.assert_array_equal(one.boxes_xywh, other.boxes_xywh)


def test_the_format_named_overrides(tmp_path):
    folder = layouts.otb(tmp_path)
    (otb,) = read_dataset(folder)
    (plain,) = read_dataset(folder, "plain")
    # The plain form is 0-based, OTB 1-based.
    assert otb.boxes_xywh[0].tolist() == [0, 1, 3, 4]
    assert plain.boxes_xywh[0].tolist() == [1, 2, 3, 4]


def test_plain_clips_come_as_read_folder_gives_them(tmp_path):
    for name in ("b/clip10", "b/clip2", "b/clip", "a/one"):
        layouts.images(tmp_path / name, 3)
        layouts.text(tmp_path / f"{name}.txt", *layouts.boxes(3))
    layouts.images(tmp_path / "c" / "many", 1)
    layouts.text(
        tmp_path / "c" / "many.jsonl",
        '{"frame": 0, "objects": [{"id": 1, "box_xywh": [1, 2, 3, 4]}]}',
    )
    layouts.images(tmp_path / "d" / "inner", 3)
    layouts.text(tmp_path / "d" / "inner" / "groundtruth_rect.txt", *layouts.boxes(3))
    (tmp_path / "e.mp4").touch()
    layouts.text(tmp_path / "e.txt", *layouts.boxes(2))
    layouts.images(tmp_path / "unlabelled", 1)
    given, expected = read_dataset(tmp_path), read_folder(tmp_path)
    assert len(given) == 7
    for one, other in zip(given, expected, strict=True):
        assert (one.name, one.dataset, one.source) == (other.name, other.dataset, other.source)


def test_what_is_no_dataset_says_what_was_looked_for(tmp_path):
    layouts.text(tmp_path / "notes.txt", "nothing")
    with pytest.raises(ValueError, match="holds no annotated clip in a known format") as caught:
        read_dataset(tmp_path)
    for known in FORMATS:
        assert (f"\n  {known.name}: {known.layout}" in str(caught.value)) == known.automatic
    with pytest.raises(ValueError, match=r"holds no clip in the format vot: list\.txt"):
        read_dataset(tmp_path, "vot")
    with pytest.raises(ValueError, match=r"no format is called 'otb100'; expected one of otb, vot"):
        read_dataset(tmp_path, "otb100")
    with pytest.raises(FileNotFoundError, match="gone does not exist"):
        read_dataset(tmp_path / "gone")
    with pytest.raises(NotADirectoryError, match=r"notes\.txt is not a folder"):
        read_dataset(tmp_path / "notes.txt")


def test_two_datasets_in_one_folder_are_not_guessed(tmp_path):
    layouts.vot(layouts.otb(tmp_path))
    with pytest.raises(ValueError, match="looks like otb and vot"):
        read_dataset(tmp_path)
    assert [s.name for s in read_dataset(tmp_path, "vot")] == ["ball"]


def test_datasets_further_below_are_read_in_their_own_formats(tmp_path):
    layouts.otb(tmp_path / "OTB" / "OTB100")
    layouts.vot(tmp_path / "others" / "vot2016")
    layouts.images(tmp_path / "mine" / "duck", 3)
    layouts.text(tmp_path / "mine" / "duck.txt", *layouts.boxes(3))
    # A link back up is no reason to go round in circles.
    (tmp_path / "others" / "back").symlink_to(tmp_path, target_is_directory=True)
    assert find_format(tmp_path).name == "otb and vot and plain"
    found = {sequence.name: sequence for sequence in read_dataset(tmp_path)}
    assert [(s.dataset, s.name) for s in found.values()] == [
        ("OTB100", "Bolt"),
        ("vot2016", "ball"),
        ("mine", "duck"),
    ]
    # OTB counts pixels from 1, the plain form from 0.
    assert found["Bolt"].boxes_xywh[0].tolist() == [0, 1, 3, 4]
    assert found["duck"].boxes_xywh[0].tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize("above", ["OTB100/Bolt", "OTB100", ".", ".."])
def test_otb_is_found_from_wherever_one_looks(tmp_path, above):
    layouts.otb(tmp_path / "data" / "sets" / "OTB100")
    folder = (tmp_path / "data" / "sets" / above).resolve()
    assert find_format(folder).name == "otb"
    for sequences in (read_dataset(folder), read_dataset(folder, "otb")):
        (bolt,) = sequences
        assert (bolt.name, bolt.dataset) == ("Bolt", "OTB100")
        assert bolt.boxes_xywh[0].tolist() == [0, 1, 3, 4]


def test_a_format_named_is_looked_for_below(tmp_path):
    layouts.otb(tmp_path / "a" / "OTB100")
    layouts.vot(tmp_path / "b" / "vot2016")
    layouts.images(tmp_path / "c" / "duck", 3)
    layouts.text(tmp_path / "c" / "duck.txt", *layouts.boxes(3))
    assert [s.name for s in read_dataset(tmp_path, "vot")] == ["ball"]
    # The plain form takes OTB's folders as well.
    assert [s.name for s in read_dataset(tmp_path, "plain")] == ["Bolt", "duck"]
    with pytest.raises(ValueError, match="holds no clip in the format got10k"):
        read_dataset(tmp_path, "got10k")
