"""Image files: folders of them, and files of several frames."""

import struct

import cv2
import numpy as np
import pytest

from re3.video import SourceError, open_source
from re3.video.image_headers import frame_pages

RAMP = np.linspace(0, 255, 60 * 80).reshape(60, 80).round()


def pages(count, dtype=np.uint8):
    return [np.full((24, 32, 3), (20 + 30 * index) % 256, dtype) for index in range(count)]


def animation(images, milliseconds):
    if not hasattr(cv2, "Animation"):
        pytest.skip("this OpenCV is older than 4.11 and writes no animations")
    made = cv2.Animation()
    made.frames = [np.dstack([image, np.full(image.shape[:2], 255, np.uint8)]) for image in images]
    made.durations = [milliseconds] * len(images)
    return made


@pytest.fixture
def several(tmp_path):
    """Makes an image file of several frames."""

    def make(name, count):
        path = tmp_path / name
        if path.suffix == ".tif":
            cv2.imwritemulti(str(path), pages(count))
        else:
            cv2.imwriteanimation(str(path), animation(pages(count), 80))
        return path

    return make


@pytest.mark.parametrize("start", [0, 4])
@pytest.mark.parametrize(
    ("name", "interval"), [("a.tif", 1 / 30), ("a.webp", 0.08), ("a.png", 0.08), ("a.gif", 0.08)]
)
def test_all_frames_of_an_image_file_are_read(several, name, interval, start):
    path = several(name, 6)
    with open_source(path, start_frame=start) as source:
        assert source.frame_count == 6
        assert source.size == (32, 24)
        frames = list(source)
    assert [frame.index for frame in frames] == list(range(start, 6))
    levels = [round((frame.image.mean() - 20) / 30) for frame in frames]
    assert levels == list(range(start, 6))
    times = [frame.timestamp for frame in frames]
    np.testing.assert_allclose(times, np.arange(start, 6) * interval, atol=2e-3)
    with pytest.raises(SourceError, match="no frame 6"):
        open_source(path, start_frame=6)


def test_a_long_stack_is_read_in_order(several):
    path = several("a.tif", 40)
    with open_source(path) as source:
        # Brightness goes around after 256.
        assert [int(f.image[0, 0, 0]) for f in source] == [(20 + 30 * i) % 256 for i in range(40)]


@pytest.mark.parametrize("name", ["a.tif", "a.webp", "a.png"])
def test_an_image_file_of_several_frames_is_known_by_its_content(several, tmp_path, name):
    several(name, 4).rename(tmp_path / "a.stk")
    with open_source(tmp_path / "a.stk") as source:
        assert len(list(source)) == 4


@pytest.mark.parametrize("name", ["a.tif", "a.webp", "a.png"])
def test_several_frames_among_images_are_refused(several, tmp_path, name):
    several(name, 3)
    cv2.imwrite(str(tmp_path / "b.png"), pages(1)[0])
    for spec in (tmp_path, str(tmp_path / "*")):
        with (
            pytest.raises(SourceError, match="holds 3 frames; expected one"),
            open_source(spec) as source,
        ):
            list(source)


def test_an_animation_that_opencv_does_not_read_is_an_error_that_says_so(several, monkeypatch):
    path = several("a.webp", 3)
    monkeypatch.delattr(cv2, "imdecodeanimation")
    with pytest.raises(SourceError, match=r"animation of 3 frames, of which OpenCV .* reads 0"):
        open_source(path)


def tiff(order, big, kinds, sample_format=1):
    """Headers of a TIFF file with a page for each NewSubfileType."""
    count, offset = ("Q", "Q") if big else ("H", "I")
    data = (b"II" if order == "<" else b"MM") + struct.pack(order + "H", 43 if big else 42)
    if big:
        data += struct.pack(order + "HH", 8, 0)
    first = len(data) + struct.calcsize(offset)
    data += struct.pack(order + offset, first)
    for index, kind in enumerate(kinds):
        entries = struct.pack(order + count, 2)
        for tag, form, value in ((254, 4, kind), (339, 3, sample_format)):
            inline = struct.pack(order + {3: "H", 4: "I"}[form], value)
            entries += struct.pack(order + "HH" + offset, tag, form, 1)
            entries += inline.ljust(struct.calcsize(offset), b"\0")
        end = len(data) + len(entries) + struct.calcsize(offset)
        data += entries + struct.pack(order + offset, end if index + 1 < len(kinds) else 0)
    return memoryview(data)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("big", [False, True])
def test_thumbnails_and_masks_in_a_tiff_are_no_frames(order, big):
    assert frame_pages(tiff(order, big, [0, 1, 0, 4, 5])) == [0, 2]
    assert frame_pages(tiff(order, big, [0])) == [0]
    assert frame_pages(tiff(order, big, [0, 0])[:-30]) == [0]  # cut off
    far = b"II+\0" + struct.pack("<HHQ", 8, 0, 2**63 + 5)
    assert frame_pages(memoryview(far)) == [0]


@pytest.mark.parametrize(
    ("low", "step"),
    [(0, 16), (7000, 4), (29315, 1), (0, 1)],  # 12 bits, thermal, centikelvin, 8 in 16
)
def test_16_bits_are_scaled_by_the_first_image(tmp_path, low, step):
    for index, shift in enumerate((0, 0, 10)):
        pixels = low + step * (RAMP + shift)
        cv2.imwrite(str(tmp_path / f"{index}.png"), pixels.astype(np.uint16))
    with open_source(tmp_path) as source:
        (note,) = source.notes
        assert f"scaled to 8 bits from {low}..{low + 255 * step}" in note
        images = [frame.image for frame in source]
    np.testing.assert_allclose(images[0][..., 0], RAMP, atol=1)
    np.testing.assert_allclose(images[2][..., 0], np.minimum(RAMP + 10, 255), atol=1)
    with open_source(tmp_path, start_frame=2) as source:
        assert source.notes == (note,)
        assert np.array_equal(next(iter(source)).image, images[2])


def test_16_bits_that_span_their_range_are_divided(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), (RAMP * 257).astype(np.uint16))
    cv2.imwrite(str(tmp_path / "1.png"), np.full((60, 80), 7000, np.uint16))
    with open_source(tmp_path) as source:
        assert source.notes == ()
        first, second = source
    assert np.array_equal(first.image[..., 0], RAMP)
    assert (second.image == 7000 // 256).all()


def test_defect_pixels_do_not_count_for_the_range(tmp_path):
    pixels = np.tile((1000 + RAMP).astype(np.uint16), (5, 5))
    pixels[7, 9], pixels[70, 5] = 65535, 0
    cv2.imwrite(str(tmp_path / "0.png"), pixels)
    with open_source(tmp_path) as source:
        (frame,) = source
    np.testing.assert_allclose(frame.image[60:, 80:, 0], np.tile(RAMP, (4, 4)), atol=1)
    assert (frame.image[7, 9, 0], frame.image[70, 5, 0]) == (255, 0)


def test_the_range_can_be_given(tmp_path):
    cv2.imwrite(str(tmp_path / "0.tif"), (7000 + 4 * RAMP).astype(np.uint16))
    with open_source(tmp_path, value_range=(7000, 7510)) as source:
        assert source.notes == ()
        (frame,) = source
    np.testing.assert_allclose(frame.image[..., 0], np.minimum(2 * RAMP, 255), atol=1)
    for given in ((5, 5), (9, 3), (-1, 9), (0, 70000), (float("nan"), 9)):
        with pytest.raises(SourceError, match="value range is"):
            open_source(tmp_path, value_range=given)


def test_a_first_image_without_contrast_is_said(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), np.full((60, 80), 7000, np.uint16))
    with open_source(tmp_path) as source:
        assert "all 7000 in the first image" in source.notes[0]


@pytest.mark.parametrize("channels", [1, 3])
def test_floating_point_is_refused(tmp_path, capfd, channels):
    image = np.zeros((24, 32, channels), np.float32).squeeze()
    cv2.imwrite(str(tmp_path / "0.tif"), image)
    with pytest.raises(SourceError, match=r"0\.tif has pixels of type float.*save them as PNG"):
        open_source(tmp_path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    "names", [("0001.jpg", "0001.png"), ("a.PNG", "a.png"), ("a.tif", "a.bmp")]
)
def test_a_frame_and_its_mask_of_one_name_are_refused(tmp_path, names):
    for name in (*names, "0002.jpg"):
        cv2.imwrite(str(tmp_path / name), pages(1)[0])
    for spec in (tmp_path, str(tmp_path / "*")):
        with pytest.raises(SourceError, match="would both be frames; expected one image a frame"):
            open_source(spec)
    with open_source(str(tmp_path / f"{names[0][:-4]}*{names[0][-4:]}")) as source:
        assert [frame.name for frame in source] == [names[0]]


@pytest.mark.parametrize(
    ("names", "note"),
    [
        (["1.jpg", "2.jpg", "3.jpg"], None),
        (["frame_09.jpg", "frame_10.jpg"], None),
        (["cat.jpg", "dog.jpg"], "of 2 kinds of names"),
        (["1.jpg", "2.jpg", "5.jpg"], r"2 numbers are missing among its images \(3 to 4\)"),
        (["1.jpg", "3.jpg", "4.jpg"], r"1 number is missing among its images \(2\)"),
        (["1.jpg", "3.jpg", "5.jpg", "9.jpg"], r"5 numbers are missing .*\(2, 4, 6 to 8\)"),
        (["00001.jpg", "00004.jpg", "00007.jpg"], "numbered 1 to 7 in steps of 3"),
        (["1.jpg", "1_mask.jpg", "2.jpg", "2_mask.jpg"], r"\(2 #\.jpg, 2 #_mask\.jpg\)"),
    ],
)
def test_what_is_unusual_about_names_is_said(tmp_path, names, note):
    for name in names:
        cv2.imwrite(str(tmp_path / name), pages(1)[0])
    with open_source(tmp_path) as source:
        if note is None:
            assert source.notes == ()
        else:
            with pytest.raises(AssertionError, match=note):
                raise AssertionError(source.notes[0])


def test_frames_have_the_names_of_their_files(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "1.png"), pages(1)[0])
    with open_source(tmp_path / "a") as source:
        assert [frame.name for frame in source] == ["1.png"]
    with open_source(str(tmp_path / "*" / "1.png")) as source:
        assert [frame.name for frame in source] == ["a/1.png", "b/1.png"]
