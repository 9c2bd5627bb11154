import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from re3 import geometry

coordinate = st.floats(-500, 500, allow_nan=False)
side = st.floats(2, 400, allow_nan=False)
boxes_xyxy = st.builds(
    lambda x, y, w, h: np.array([x, y, x + w, y + h]), coordinate, coordinate, side, side
)


@pytest.mark.parametrize(
    ("source", "target", "box", "expected"),
    [
        ("xywh", "xyxy", (10, 20, 30, 40), (10, 20, 40, 60)),
        ("xywh", "cxcywh", (10, 20, 30, 40), (25, 40, 30, 40)),
        ("xyxy", "xywh", (10, 20, 40, 60), (10, 20, 30, 40)),
        ("xyxy", "cxcywh", (10, 20, 40, 60), (25, 40, 30, 40)),
        ("cxcywh", "xyxy", (25, 40, 30, 40), (10, 20, 40, 60)),
        ("xywh", "xywh", (1, 2, 3, 4), (1, 2, 3, 4)),
    ],
)
def test_convert(source, target, box, expected):
    np.testing.assert_allclose(geometry.convert(box, source, target), expected)


@pytest.mark.parametrize(
    "use",
    [
        lambda boxes: geometry.convert(boxes, "xywh", "xyxy"),
        lambda boxes: geometry.search_region(boxes, 2.0),
        lambda boxes: geometry.clip_inside(boxes, 100, 80),
    ],
)
def test_a_wrong_shape_is_named(use):
    with pytest.raises(ValueError, match=r"shape \(3,\).*\[\.\.\., 4\]"):
        use([1, 2, 3])


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((0, 0, 10, 10), (0, 0, 10, 10), 1.0),  # the same
        ((0, 0, 10, 10), (5, 0, 15, 10), 1 / 3),  # half shifted
        ((0, 0, 10, 10), (2, 2, 4, 4), 0.04),  # one inside the other
        ((0, 0, 10, 10), (10, 0, 20, 10), 0.0),  # touching
        ((0, 0, 10, 10), (50, 50, 60, 60), 0.0),  # apart
        ((5, 5, 5, 5), (5, 5, 5, 5), 0.0),  # no area at all
        ((np.nan,) * 4, (0, 0, 1, 1), np.nan),  # absent
    ],
)
def test_iou(a, b, expected):
    np.testing.assert_allclose(geometry.iou_xyxy(a, b), expected)
    np.testing.assert_allclose(
        geometry.iou_xywh(geometry.convert(a, "xyxy", "xywh"), geometry.convert(b, "xyxy", "xywh")),
        expected,
    )


def test_search_region_of_the_paper_is_twice_the_box():
    np.testing.assert_allclose(geometry.search_region((100, 50, 140, 110), 2.0), (80, 20, 160, 140))


def test_an_object_that_has_not_moved_encodes_to_the_middle():
    box = (100, 50, 140, 110)
    np.testing.assert_allclose(
        geometry.encode(box, geometry.search_region(box, 2.0)), (2.5, 2.5, 7.5, 7.5)
    )


@given(boxes_xyxy, boxes_xyxy, st.floats(1, 5))
def test_decode_inverts_encode(box, previous, context):
    region = geometry.search_region(previous, context)
    np.testing.assert_allclose(
        geometry.decode(geometry.encode(box, region), region), box, atol=1e-6
    )


@settings(max_examples=30)
@given(st.integers(-40, 40), st.integers(-40, 40), st.floats(4, 60), st.floats(4, 60))
def test_crop_of_a_shifted_image_is_the_shifted_crop(dx, dy, w, h):
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 4)
    region = np.array([60.3, 40.7, 60.3 + w, 40.7 + h])
    shifted = np.zeros((300, 300, 3), np.uint8)
    shifted[80 + dy : 200 + dy, 60 + dx : 220 + dx] = image
    here = geometry.crop(image, region, 32).astype(int)
    there = geometry.crop(shifted, region + [60 + dx, 80 + dy] * 2, 32).astype(int)
    # OpenCV interpolates at 1/32 of a pixel, so that rounding may differ by a level or two.
    assert np.abs(here - there).max() <= 3


def test_crop_at_whole_pixels_is_a_slice():
    image = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    np.testing.assert_array_equal(geometry.crop(image, (10, 20, 42, 52), 32), image[20:52, 10:42])


@pytest.mark.parametrize("size", [16, 64])  # averaged first; warped directly
def test_crop_over_the_border_is_filled(size):
    image = np.full((50, 50, 3), 200, np.uint8)
    crop = geometry.crop(image, (-50, -50, 50, 50), size, fill=(7, 8, 9))
    assert (crop[: size // 2 - 1, : size // 2 - 1] == (7, 8, 9)).all()
    assert (crop[size // 2 + 1 :, size // 2 + 1 :] == 200).all()


@pytest.mark.parametrize("size", [16, 256])
def test_crop_wholly_outside_is_the_fill(size):
    image = np.full((50, 50, 3), 200, np.uint8)
    crop = geometry.crop(image, (500, 500, 600, 600), size, fill=(1, 2, 3))
    assert crop.shape == (size, size, 3)
    assert (crop == (1, 2, 3)).all()


def test_a_box_lands_where_encode_says_in_a_crop_that_is_averaged():
    image = np.zeros((600, 600, 3), np.uint8)
    image[200:400, 250:310] = 255
    region = np.array([100.0, 100.0, 500.0, 500.0])
    crop = geometry.crop(image, region, 64)[:, :, 0]
    x1, y1, x2, y2 = geometry.encode((250, 200, 310, 400), region) / 10 * 64
    rows, columns = np.nonzero(crop > 127)
    np.testing.assert_allclose(
        (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1), (x1, y1, x2, y2), atol=1.0
    )


@pytest.mark.parametrize(
    ("box", "message"),
    [
        ((1, 2, 3), "four numbers"),  # too short
        (("a", 1, 2, 3), "not four numbers"),  # text
        ((1, 2, np.nan, 4), "NaN"),
        ((1, 2, np.inf, 4), "NaN or infinity"),
        ((1, 2, 0, 4), "no area"),
        ((1, 2, 5, -4), "no area"),
        ((0.3, 0.3, 0.2, 0.4), "smaller than a pixel.*shares of the frame by its 100 x 80"),
        ((100, 2, 5, 4), "outside the frame of 100 x 80"),  # right
        ((-5, 2, 5, 4), "outside"),  # left
        ((1, 80, 5, 4), "outside"),  # below
        ((1, -4, 5, 4), "outside"),  # above
    ],
)
def test_validate_box_refuses(box, message):
    with pytest.raises(ValueError, match=message):
        geometry.validate_box(box, 100, 80)


@pytest.mark.parametrize(
    "box", [(0, 0, 100, 80), (-5, -5, 6, 6), (99.5, 79.5, 50, 50), (3, 3, 0.5, 20)]
)
def test_validate_box_accepts_boxes_partly_outside(box):
    np.testing.assert_array_equal(geometry.validate_box(box, 100, 80), box)


@given(st.lists(st.floats(-1e6, 1e6), min_size=4, max_size=4))
def test_clip_inside_is_finite_and_has_size(corners):
    box = geometry.convert(geometry.clip_inside(corners, 100, 80), "xyxy", "xywh")
    assert np.isfinite(box).all()
    assert (box[2:] >= geometry.SMALLEST_SIDE - 1e-6).all()
    assert geometry.iou_xywh(box, (-1, -1, 102, 82)) > 0  # it touches the frame


def test_sides_are_kept_near_those_of_another_box():
    boxes = [[0, 0, 100, 10], [40, 40, 44, 80], [10, 10, 30, 30]]
    near = geometry.sides_near(boxes, [0, 0, 20, 20], 1.5)
    np.testing.assert_allclose(
        near, [[35, -1.6666667, 65, 11.6666667], [35.3333333, 45, 48.6666667, 75], [10, 10, 30, 30]]
    )
