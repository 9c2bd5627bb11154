"""Stills in the layouts they are published in."""

import json

import cv2
import layouts
import numpy as np
import pytest
import still_layouts
from PIL import Image
from still_layouts import HEIGHT, LARGE, SMALL, WIDTH

from re3.data.masks import Polygons, Runs, run_lengths
from re3.data.picture_size import picture_size
from re3.data.simulator import simulate
from re3.data.still_formats import STILL_FORMATS, find_stills, notes_of, read_stills
from re3.data.stills import LARGEST_PATCH
from re3.result import Result, Status
from re3.video.results import open_results

ANNOTATED = [name for name in still_layouts.BUILDERS if name != "images"]


@pytest.mark.parametrize("name", still_layouts.BUILDERS)
def test_a_folder_is_recognised_by_its_structure(tmp_path, name):
    folder = still_layouts.BUILDERS[name](tmp_path / "data")
    assert [(known.name, path) for known, path in find_stills(folder)] == [(name, folder)]
    # Any folder with an image in it may be cut into patches, which is why that comes last.
    fitting = [known.name for known in STILL_FORMATS if known.detect(folder)]
    assert set(fitting) == {name, "images"}


@pytest.mark.parametrize("name", ANNOTATED)
def test_objects_below_a_hundredth_of_the_picture_are_discarded(tmp_path, name):
    folder = still_layouts.BUILDERS[name](tmp_path / "data")
    (still,) = read_stills(folder)
    assert still.image.is_file()
    picture = still.read()
    box, _ = still.draw_object(WIDTH, HEIGHT, np.random.default_rng(0))
    np.testing.assert_allclose(box, LARGE, atol=1e-4)
    x, y, w, h = LARGE
    inside = picture[y + 2 : y + h - 2, x + 2 : x + w - 2, 2]
    assert inside.min() > 200  # the box is where the object is
    if name != "masks":
        (both,) = read_stills(folder, smallest_share=0.0)
        assert len(both.boxes_xywh) == 2


@pytest.mark.parametrize("name", still_layouts.MASKED)
def test_masks_cover_the_object(tmp_path, name):
    (still,) = read_stills(still_layouts.BUILDERS[name](tmp_path / "data"))
    assert still.masked
    _, alpha = still.draw_object(WIDTH, HEIGHT, np.random.default_rng(0))
    expected = np.zeros((HEIGHT, WIDTH), bool)
    x, y, w, h = LARGE
    expected[y : y + h, x : x + w] = True
    # An outline is drawn with its border: a pixel more on two sides.
    assert ((alpha > 0) & expected).sum() == expected.sum()
    assert (alpha > 0).sum() <= (w + 1) * (h + 1)


@pytest.mark.parametrize("name", still_layouts.BUILDERS)
def test_every_format_can_be_simulated_from(tmp_path, name):
    stills = read_stills(still_layouts.BUILDERS[name](tmp_path / "data"))
    for seed in range(3):
        scene = simulate(stills, 4, np.random.default_rng(seed))
        assert scene.render(0, (0, 0, *scene.size), 32, 24).shape == (24, 32, 3)
        assert scene.still in stills


def test_folders_of_several_formats_are_read_each_in_its_own(tmp_path):
    for name in ANNOTATED:
        still_layouts.BUILDERS[name](tmp_path / "data" / name)
    assert {known.name for known, _ in find_stills(tmp_path / "data")} == set(ANNOTATED)
    assert len(read_stills(tmp_path / "data")) == len(ANNOTATED)
    assert len(read_stills(tmp_path / "data", "voc")) == 1


def test_random_patches_are_large_enough_and_inside(tmp_path):
    (still,) = read_stills(still_layouts.images(tmp_path), "images", 0.05)
    rng = np.random.default_rng(0)
    boxes = np.array([still.draw_object(WIDTH, HEIGHT, rng)[0] for _ in range(200)])
    share = boxes[:, 2] * boxes[:, 3] / (WIDTH * HEIGHT)
    assert share.min() >= 0.05 - 1e-9
    assert share.max() <= LARGEST_PATCH + 1e-9
    assert np.ptp(share) > 0.1
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, :2] + boxes[:, 2:] <= (WIDTH + 1e-9, HEIGHT + 1e-9)).all()
    assert not still.masked


def test_an_index_wins_over_what_else_the_folder_looks_like(tmp_path):
    still_layouts.masks(still_layouts.boxes(tmp_path))
    assert [known.name for known, _ in find_stills(tmp_path)] == ["boxes"]


def test_a_folder_in_two_formats_has_to_be_named(tmp_path):
    still_layouts.coco(still_layouts.yolo(tmp_path))
    with pytest.raises(ValueError, match="looks like coco and yolo; name the format"):
        find_stills(tmp_path)
    assert len(read_stills(tmp_path, "yolo")) == 1


@pytest.mark.parametrize(
    ("change", "format", "error", "told"),
    [
        (lambda f: None, "coc", ValueError, "no format of stills is called 'coc'; expected one"),
        (lambda f: None, "voc", ValueError, "holds nothing in the format voc: JPEGImages"),
        (
            lambda f: None,
            None,
            ValueError,
            "known format; expected one of\n  boxes",
        ),
        (still_layouts.images, "coco", ValueError, "holds nothing in the format coco"),
    ],
)
def test_what_is_not_there_is_told(tmp_path, change, format, error, told):
    change(tmp_path)
    with pytest.raises(error, match=told):
        read_stills(tmp_path, format)


def test_without_a_large_object_it_says_so(tmp_path):
    still_layouts.picture(tmp_path / "images/a.jpg", SMALL)
    layouts.text(tmp_path / "labels/a.txt", still_layouts.yolo_line(SMALL))
    with pytest.raises(ValueError, match=r"yolo\) has no object of 1.00% .* Lower smallest_share"):
        read_stills(tmp_path)


def test_no_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match="gone does not exist"):
        read_stills(tmp_path / "gone")
    with pytest.raises(NotADirectoryError, match="is not a folder"):
        read_stills(still_layouts.picture(tmp_path / "a.png"))


# COCO


def coco_with(folder, *annotations, name="000000000009.jpg"):
    still_layouts.coco(folder)
    document = still_layouts.coco_document(*annotations, name=name)
    layouts.text(folder / "annotations/instances_train2017.json", json.dumps(document))
    return folder


def runs_of(pixels) -> list[int]:
    """Lengths of the runs of a mask `[H, W]`, column by column, zeros first."""
    counts, value = [0], False
    for pixel in pixels.T.ravel():
        if pixel != value:
            counts.append(0)
            value = bool(pixel)
        counts[-1] += 1
    return counts


def as_text(counts) -> str:
    """COCO's text of runs, written here from its description."""
    text = ""
    for i, count in enumerate(counts):
        value = count - counts[i - 2] if i > 2 else count
        while True:
            group, value = value & 31, value >> 5
            more = value != (-1 if group & 16 else 0)
            text += chr(48 + (group | 32 if more else group))
            if not more:
                break
    return text


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_runs_of_coco_are_decoded(tmp_path, compressed, seed):
    rng = np.random.default_rng(seed)
    pixels = cv2.resize(rng.random((6, 7)), (WIDTH, HEIGHT)) > 0.55
    counts = runs_of(pixels)
    stored = as_text(counts) if compressed else counts
    folder = coco_with(
        tmp_path, {"bbox": list(LARGE), "segmentation": {"counts": stored, "size": [HEIGHT, WIDTH]}}
    )
    (still,) = read_stills(folder)
    _, alpha = still.draw_object(WIDTH, HEIGHT, rng)
    np.testing.assert_array_equal(alpha == 255, pixels)


def test_numbers_of_any_length_and_sign_survive_the_text():
    counts = [0, 5, 15, 16, 31, 32, 1, 1000, 3, 40000, 7, 1]
    assert run_lengths(as_text(counts)) == counts


@pytest.mark.parametrize(
    ("text", "told"), [("0!", "'!' in a mask of runs"), ("0P", "breaks off within a number")]
)
def test_broken_runs_are_told(text, told):
    with pytest.raises(ValueError, match=told):
        run_lengths(text)


def test_runs_of_another_size_are_told():
    with pytest.raises(ValueError, match="the runs of a mask are 5 pixels long; expected 4 x 3"):
        Runs((2, 3), (3, 4)).read(4, 3)
    with pytest.raises(ValueError, match="has 4 x 3 pixels; expected 8 x 6"):
        Runs((2, 10), (3, 4)).read(8, 6)


def test_rings_that_overlap_do_not_cancel():
    ring = np.array([[2, 2], [8, 2], [8, 8], [2, 8]], np.float32)
    alpha = Polygons((ring, ring + 1)).read(12, 12)
    assert alpha[5, 5] == 255


def test_crowds_are_left_out(tmp_path):
    folder = coco_with(
        tmp_path, {"bbox": list(LARGE)}, {"bbox": [0, 0, WIDTH, HEIGHT], "iscrowd": 1}
    )
    (still,) = read_stills(folder)
    np.testing.assert_array_equal(still.boxes_xywh, [LARGE])


@pytest.mark.parametrize("where", ["images/train2017", "images", "."])
def test_images_of_coco_may_lie_elsewhere(tmp_path, where):
    folder = still_layouts.coco(tmp_path)
    (folder / where).mkdir(parents=True, exist_ok=True)
    (folder / "train2017/000000000009.jpg").rename(folder / where / "000000000009.jpg")
    (still,) = read_stills(folder)
    assert still.image.is_file()


def test_an_export_beside_its_images(tmp_path):
    still_layouts.picture(tmp_path / "train/x.jpg", LARGE)
    document = still_layouts.coco_document({"bbox": list(LARGE)}, name="x.jpg")
    layouts.text(tmp_path / "train/_annotations.coco.json", json.dumps(document))
    (still,) = read_stills(tmp_path)
    assert (still.image, still.dataset) == (tmp_path / "train/x.jpg", f"{tmp_path.name}-train")


@pytest.mark.parametrize(
    ("annotation", "name", "told"),
    [
        ({"bbox": [1, 2, 3]}, None, r"instances_train2017\.json, annotation .*; expected"),
        ({"id": 7}, None, r"annotation 7 of 000000000009\.jpg: no 'bbox'; expected"),
        ({"bbox": list(LARGE), "image_id": 8}, None, "an object of image 8, which is not there"),
        ({"bbox": list(LARGE)}, "gone.jpg", "names an image gone.jpg, which is in none of"),
    ],
)
def test_a_broken_coco_file_is_told(tmp_path, annotation, name, told):
    folder = coco_with(tmp_path, annotation, name=name or "000000000009.jpg")
    with pytest.raises((ValueError, FileNotFoundError), match=told):
        read_stills(folder)


RING = [10, 5, 30, 5, 30, 20, 10, 20]  # about LARGE


@pytest.mark.parametrize(
    ("segmentation", "told"),
    [
        ([[]], "a polygon of 0 numbers"),
        ([[1, 2, 3, 4]], "a polygon of 4 numbers"),  # a line encloses nothing
        ([[1, 2], []], "a polygon of 2 and 0 numbers"),
        ([[1, 2, 3, 4, 5, 6, 7]], "a polygon of 7 numbers"),
        ([[1, 2, 3, None, 5, 6]], ""),
        ([[1, 2, 3, float("nan"), 5, 6]], "a polygon of 6 numbers"),
        ([["a", 2, 3, 4, 5, 6]], ""),
        ("1 2 3", "a segmentation '1 2 3'"),
        ({"counts": [3, 4], "size": [HEIGHT, WIDTH]}, "runs 7 pixels long"),
        ({"counts": "0!", "size": [HEIGHT, WIDTH]}, "'!' in a mask of runs"),
        ({"counts": [WIDTH * HEIGHT], "size": [WIDTH, HEIGHT]}, "runs for 30 x 40 pixels"),
        ({"counts": [WIDTH * HEIGHT]}, "no 'size'"),
    ],
)
def test_an_outline_that_cannot_be_used_leaves_the_box(tmp_path, segmentation, told):
    folder = coco_with(
        tmp_path,
        {"id": 1, "bbox": list(LARGE), "segmentation": [RING]},
        {"id": 2, "bbox": list(LARGE), "segmentation": segmentation},
        {"id": 3, "bbox": list(LARGE), "segmentation": [RING]},
    )
    (still,) = read_stills(folder)
    np.testing.assert_array_equal(still.boxes_xywh, [LARGE] * 3)
    assert [mask is None for mask in still.masks] == [False, True, False]
    (note,) = still.notes
    assert "instances_train2017.json, annotation 2 of 000000000009.jpg: no outline" in note
    assert told in note
    assert note.endswith("its box is used")


@pytest.mark.parametrize("segmentation", [[RING, []], [[1, 2], RING], RING])
def test_what_encloses_nothing_beside_an_outline_is_passed_over(tmp_path, segmentation):
    folder = coco_with(tmp_path, {"bbox": list(LARGE), "segmentation": segmentation})
    (still,) = read_stills(folder)
    assert (still.masked, still.notes) == (True, ())


def test_notes_are_counted_and_the_first_is_told(tmp_path):
    broken = {"bbox": list(LARGE), "segmentation": [[]]}
    folder = coco_with(tmp_path, {"id": 4, **broken}, {"id": 5, **broken})
    (told,) = notes_of(read_stills(folder))
    assert told.startswith("2 annotations were put right, the first: ")
    assert "annotation 4 of" in told
    assert notes_of([]) == []


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ([{"image_id": 9, "bbox": list(LARGE), "score": 0.5}], "COCO's results, a list of found"),
        ([1, 2], "it holds a list, not annotations"),
        ({"images": 3}, "expected"),
    ],
)
@pytest.mark.parametrize("where", ["annotations/instances_val.json", "found.coco.json"])
def test_what_is_given_in_place_of_annotations_is_named(tmp_path, content, told, where):
    still_layouts.picture(tmp_path / "val" / "000000000009.jpg", LARGE)
    layouts.text(tmp_path / where, json.dumps(content))
    with pytest.raises(ValueError, match=told):
        read_stills(tmp_path)


def test_results_beside_pictures_are_no_reason_to_take_patches(tmp_path):
    still_layouts.picture(tmp_path / "a.jpg", LARGE)
    result = {"image_id": 9, "category_id": 1, "bbox": list(LARGE), "score": 0.5}
    layouts.text(tmp_path / "detections.json", json.dumps([result]))
    with pytest.raises(ValueError, match="COCO's results, a list of found boxes"):
        read_stills(tmp_path)
    # Beside annotations they are passed over.
    document = still_layouts.coco_document({"bbox": list(LARGE)}, name="a.jpg")
    layouts.text(tmp_path / "_annotations.coco.json", json.dumps(document))
    assert len(read_stills(tmp_path)) == 1


def test_what_re3_track_writes_of_a_video_is_named(tmp_path):
    still_layouts.picture(tmp_path / "a.jpg", LARGE)
    with open_results(tmp_path / "clip.coco.json") as results:
        results.frame_size = (WIDTH, HEIGHT)
        results.write(0, 0.0, [Result(LARGE, 0.9, Status.TRACKED, 1, "dog")])
    with pytest.raises(FileNotFoundError, match="holds results of `re3 track`"):
        read_stills(tmp_path)


# Sizes


def turned(path, orientation):
    """A picture of LARGE that its EXIF orientation turns."""
    still_layouts.picture(path, LARGE)
    with Image.open(path) as image:
        exif = image.getexif()
        exif[0x0112] = orientation
        image.save(path, exif=exif)


@pytest.mark.parametrize("suffix", [".jpg", ".webp"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_size_of_a_picture_is_the_decoded_one(tmp_path, suffix, orientation):
    path = tmp_path / f"a{suffix}"
    turned(path, orientation)
    height, width = cv2.imread(str(path)).shape[:2]
    assert picture_size(path) == (width, height)
    if suffix == ".jpg":
        assert ((width, height) == (HEIGHT, WIDTH)) == (orientation >= 5)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif"])
def test_the_size_is_told_by_every_kind_of_header(tmp_path, suffix):
    assert picture_size(still_layouts.picture(tmp_path / f"a{suffix}")) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("name", ["boxes", "imagenet-det", "coco", "voc", "masks"])
def test_a_picture_of_another_size_than_stated_is_refused(tmp_path, name):
    folder = still_layouts.BUILDERS[name](tmp_path / "data")
    (image,) = (p for p in folder.rglob("*.[jJ]*") if "json" not in p.name and "val" not in p.name)
    still_layouts.picture(image, width=2 * WIDTH, height=2 * HEIGHT)  # a resized copy
    with pytest.raises(ValueError, match=f"{image.name} is decoded to 80 x 60 .* 40 x 30, for"):
        read_stills(folder)


@pytest.mark.parametrize("name", ["boxes", "voc"])
def test_an_outline_of_another_size_leaves_the_box(tmp_path, name):
    folder = still_layouts.BUILDERS[name](tmp_path)
    if name == "voc":
        (outline,) = folder.rglob("*.png")
        layouts.palette_png(outline, np.ones((2 * HEIGHT, 2 * WIDTH), np.uint8), [(0, 0, 0)] * 256)
    else:
        outline = still_layouts.mask(folder / "a.png", width=2 * WIDTH, height=2 * HEIGHT)
        text = (folder / "boxes.jsonl").read_text().replace("null", '"a.png"')
        (folder / "boxes.jsonl").write_text(text)
    (still,) = read_stills(folder)
    assert not still.masked
    (note,) = still.notes
    assert f"{outline.name} is 80 x 60 pixels, but" in note
    outline.unlink()
    if name == "boxes":
        with pytest.raises(FileNotFoundError, match=r"a\.png does not exist"):
            read_stills(folder)


@pytest.mark.parametrize("name", ["coco", "voc"])
def test_a_picture_that_exif_turns_is_refused(tmp_path, name):
    folder = still_layouts.BUILDERS[name](tmp_path / "data")
    (image,) = folder.rglob("*.jpg")
    turned(image, 6)
    with pytest.raises(ValueError, match=r"decoded to 30 x 40 pixels \(is it turned by its EXIF"):
        read_stills(folder)
    turned(image, 3)  # on its head: the size is the stated one
    assert len(read_stills(folder)) == 1


def test_all_pictures_of_other_sizes_are_counted(tmp_path):
    still_layouts.picture(tmp_path / "JPEGImages/a.jpg", width=20)
    still_layouts.picture(tmp_path / "JPEGImages/b.jpg", width=20)
    still_layouts.picture(tmp_path / "JPEGImages/c.jpg")
    for name in "abc":
        still_layouts.xml(tmp_path / f"Annotations/{name}.xml", LARGE)
    with pytest.raises(ValueError, match=r"2 of 3 pictures of .*, the first of them: .*a\.jpg is"):
        read_stills(tmp_path)


# VOC and ImageNet


def test_without_a_size_the_picture_is_asked(tmp_path):
    folder = still_layouts.voc(tmp_path)
    still_layouts.xml(folder / "Annotations/2007_000032.xml", LARGE, size=(0, 0), first_pixel=1)
    (still,) = read_stills(folder)
    np.testing.assert_array_equal(still.boxes_xywh, [LARGE])


@pytest.mark.parametrize("name", ["voc", "imagenet-det"])
def test_broken_xml_and_missing_images_are_told(tmp_path, name):
    folder = still_layouts.BUILDERS[name](tmp_path)
    (text,) = (p for p in folder.rglob("*.xml") if "val" not in p.name)
    (image,) = (p for p in folder.rglob("*.[jJ]*") if p.stem == text.stem)
    image.unlink()
    still_layouts.picture(image.with_name("other.jpg"))
    with pytest.raises(FileNotFoundError, match=text.stem):
        read_stills(folder)
    still_layouts.picture(image)
    text.write_text("<annotation><object><bndbox><xmin>1</xmin></bndbox></object></annotation>")
    with pytest.raises(ValueError, match=r"\.xml: an object has no bndbox/ymin; expected <size>"):
        read_stills(folder)
    text.write_text("<annotation>")
    with pytest.raises(ValueError, match=r"\.xml: no element found|\.xml: .*; expected <size>"):
        read_stills(folder)


def test_splits_of_imagenet_are_datasets(tmp_path):
    (still,) = read_stills(still_layouts.imagenet_det(tmp_path / "ILSVRC"))
    assert still.dataset == "ILSVRC-train"


# YOLO


@pytest.mark.parametrize("layout", ["split first", "beside"])
def test_other_places_of_labels(tmp_path, layout):
    inner = {"split first": ("train/images", "train/labels"), "beside": ("", "")}[layout]
    still_layouts.picture(tmp_path / inner[0] / "a.jpg", LARGE)
    layouts.text(tmp_path / inner[1] / "a.txt", still_layouts.yolo_line(LARGE))
    (still,) = read_stills(tmp_path)
    box, _ = still.draw_object(WIDTH, HEIGHT, np.random.default_rng(0))
    np.testing.assert_allclose(box, LARGE, atol=1e-3)


def test_an_outline_becomes_a_mask(tmp_path):
    folder = still_layouts.yolo(tmp_path)
    layouts.text(folder / "labels/train/a.txt", "0 0.25 0.2 0.75 0.2 0.5 0.8")
    (still,) = read_stills(folder)
    box, alpha = still.draw_object(WIDTH, HEIGHT, np.random.default_rng(0))
    np.testing.assert_allclose(box, (10, 6, 20, 18), atol=1e-4)
    share = (alpha > 0).sum() / (box[2] * box[3])
    assert 0.45 < share < 0.62  # a triangle


@pytest.mark.parametrize(
    "line", ["0 0.5 0.5 0.2", "0 12 10 5 5", "0.5 0.5 0.5 0.2 0.2", "0 0.5 0.5 0.2 0.2 0.9", "x"]
)
def test_broken_labels_are_told(tmp_path, line):
    folder = still_layouts.yolo(tmp_path)
    layouts.text(folder / "labels/train/a.txt", still_layouts.yolo_line(LARGE), line)
    layouts.text(folder / "labels/train/background.txt", still_layouts.yolo_line(LARGE))
    with pytest.raises(ValueError, match=r"a\.txt, line 2: .*; expected class"):
        read_stills(folder)


# Masks


def test_masks_beside_pictures(tmp_path):
    still_layouts.picture(tmp_path / "a.jpg", LARGE)
    still_layouts.picture(tmp_path / "without.jpg")
    still_layouts.mask(tmp_path / "a.png")
    (still,) = read_stills(tmp_path)
    assert still.image.name == "a.jpg"


def test_ids_in_a_mask_are_objects(tmp_path):
    folder = still_layouts.masks(tmp_path)
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[5:20, 10:30], ids[22:28, 2:12] = 1, 2
    cv2.imwrite(str(folder / "DUTS-TR-Mask" / "a.png"), ids)
    (still,) = read_stills(folder)
    np.testing.assert_array_equal(still.boxes_xywh, [LARGE, (2, 22, 10, 6)])
    np.testing.assert_array_equal(still.masks[1].read(WIDTH, HEIGHT) > 0, ids == 2)


def test_a_mask_of_another_size_names_the_picture(tmp_path):
    folder = still_layouts.masks(tmp_path)
    still_layouts.mask(folder / "DUTS-TR-Mask/a.png", width=80, height=60)
    with pytest.raises(ValueError, match=r"a\.jpg is decoded to 40 x 30 .*a\.png states 80 x 60"):
        read_stills(folder)


def test_a_mask_that_cannot_be_read_is_told(tmp_path):
    folder = still_layouts.masks(tmp_path)
    (folder / "DUTS-TR-Mask" / "a.png").write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"a\.png cannot be read as an image"):
        read_stills(folder)
