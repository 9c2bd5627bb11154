import cv2
import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset
from re3.data.formats.davis import read_mask


def test_a_box_an_id(tmp_path):
    first, second = read_dataset(layouts.davis(tmp_path / "DAVIS"))
    assert (first.name, second.name) == ("bear/1", "bear/2")
    assert (first.dataset, first.label, first.occluded) == ("DAVIS", None, None)
    np.testing.assert_array_equal(first.boxes_xywh, [[3, 4, 6, 4], [4, 4, 6, 4], [5, 4, 6, 4]])
    assert (second.start_frame, second.boxes_xywh.tolist()) == (1, [[20, 10, 2, 3]] * 2)
    assert first.source == tmp_path / "DAVIS/JPEGImages/480p/bear"


def test_all_ids_can_be_one_object(tmp_path):
    (bear,) = read_dataset(layouts.davis(tmp_path), "davis-merged")
    assert bear.name == "bear"
    np.testing.assert_array_equal(bear.boxes_xywh, [[3, 4, 6, 4], [4, 4, 18, 9], [5, 4, 17, 9]])


def grey(path, *, top):
    mask = np.zeros((24, 32), np.uint8)
    mask[top : top + 2, 5:8] = 255
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)


def test_grey_masks_without_a_folder_of_sizes(tmp_path):
    layouts.images(tmp_path / "JPEGImages" / "cow", 2, first=0, digits=5)
    for frame in range(2):
        grey(tmp_path / "Annotations" / "cow" / f"{frame:05d}.png", top=frame)
    (cow,) = read_dataset(tmp_path)
    assert (cow.name, cow.boxes_xywh.tolist()) == ("cow", [[5, 0, 3, 2], [5, 1, 3, 2]])


def test_480p_is_taken_and_one_mask_gives_the_first_box(tmp_path):
    layouts.davis(tmp_path)
    for tree in ("JPEGImages", "Annotations"):
        (tmp_path / tree / "1080p" / "bear").mkdir(parents=True)
    for frame in (1, 2):
        (tmp_path / f"Annotations/480p/bear/{frame:05d}.png").unlink()
    (bear,) = read_dataset(tmp_path)
    assert (bear.name, bear.boxes_xywh.tolist()) == ("bear", [[3, 4, 6, 4]])


def test_indices_are_read_whatever_the_palette(tmp_path):
    ids = np.array([[0, 1, 2], [3, 3, 0]], np.uint8)
    path = layouts.palette_png(
        tmp_path / "m.png", ids, [(1, 2, 3), (3, 2, 1), (9, 9, 9), (0, 0, 9)]
    )
    np.testing.assert_array_equal(read_mask(path), ids)
    # Entries that nothing uses repeat a colour: the first index counts.
    path = layouts.palette_png(tmp_path / "r.png", ids, [*layouts.PALETTE, *[(0, 0, 0)] * 9])
    np.testing.assert_array_equal(read_mask(path), ids)


def test_broken_masks_name_the_file(tmp_path):
    masks = layouts.davis(tmp_path) / "Annotations/480p/bear"
    good = (masks / "00001.png").read_bytes()
    cv2.imwrite(str(masks / "00001.png"), np.zeros((24, 32, 3), np.uint8))
    with pytest.raises(ValueError, match=r"00001\.png is in full colour"):
        read_dataset(tmp_path)
    (masks / "00001.png").write_bytes(b"GIF89a")
    with pytest.raises(ValueError, match=r"00001\.png is not a PNG"):
        read_dataset(tmp_path)
    (masks / "00001.png").write_bytes(good[:60])
    with pytest.raises(ValueError, match=r"00001\.png .*expected a mask: restore it"):
        read_dataset(tmp_path)
    (masks / "00001.png").write_bytes(good)
    (masks / "00002.png").rename(masks / "00003.png")
    with pytest.raises(ValueError, match=r"00003\.png: .* has no image 00003"):
        read_dataset(tmp_path)
    (masks / "00003.png").unlink()
    with pytest.raises(ValueError, match=r"bear has 2 masks, but .* 3 images"):
        read_dataset(tmp_path)
    (masks / "00001.png").unlink()
    layouts.palette_png(masks / "00000.png", np.zeros((24, 32)), layouts.PALETTE)
    with pytest.raises(ValueError, match="bear: no mask has an object"):
        read_dataset(tmp_path)
