"""Crops about whole pixels: what is inside is resized, the rest filled afterwards."""

import cv2
import numpy as np
import pytest

from re3.whole_pixel_crop import whole_pixel_crop

FILL = (1.0, 2.0, 3.0)
NOISE = np.random.default_rng(0).integers(10, 256, (60, 80, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("region", "inside", "place"),
    [
        ((10, 20, 50, 60), (10, 20, 50, 60), (0, 0, 32, 32)),  # inside
        ((9.6, 20.4, 49.9, 59.7), (10, 20, 50, 60), (0, 0, 32, 32)),  # rounded
        ((10.5, 19.5, 50.5, 60.5), (10, 20, 50, 60), (0, 0, 32, 32)),  # halves become even
        ((-10, 10, 30, 50), (0, 10, 30, 50), (8, 0, 24, 32)),  # over the left border
        ((60, 40, 100, 80), (60, 40, 80, 60), (0, 0, 16, 16)),  # over the bottom right corner
        ((-10, -5, 90, 65), (0, 0, 80, 60), (3, 2, 26, 27)),  # 3.2 and 25.6; 2.3 and 27.4
        ((79, 0, 279, 40), (79, 0, 80, 40), (0, 0, 1, 32)),  # a column too thin for a pixel
    ],
)
def test_the_part_inside_is_resized_and_the_rest_filled(region, inside, place):
    left, top, right, bottom = inside
    x, y, columns, rows = place
    expected = np.full((32, 32, 3), FILL, np.uint8)
    resized = cv2.resize(NOISE[top:bottom, left:right], (columns, rows))
    expected[y : y + rows, x : x + columns] = resized
    np.testing.assert_array_equal(whole_pixel_crop(NOISE, region, 32, FILL), expected)


@pytest.mark.parametrize(
    "region", [(80, 0, 120, 40), (-40, 0, 0, 40), (0, -90, 40, -50), (1e6, 1e6, 2e6, 2e6)]
)
def test_a_region_wholly_outside_is_the_fill(region):
    assert (whole_pixel_crop(NOISE, region, 32, FILL) == FILL).all()


def test_a_region_that_rounds_to_nothing_is_a_pixel():
    crop = whole_pixel_crop(NOISE, (1.5, 1.5, 2.5, 2.5), 16)
    assert (crop == NOISE[2, 2]).all()


def test_every_region_fits_its_crop():
    rng = np.random.default_rng(1)
    for _ in range(2000):
        low = rng.uniform(-150, 90, 2)
        region = np.concatenate([low, low + rng.uniform(1, 250, 2)])
        crop = whole_pixel_crop(NOISE, region, 33)
        left, top, right, bottom = np.round(region)
        outside = right <= 0 or bottom <= 0 or left >= 80 or top >= 60
        assert crop.shape == (33, 33, 3)
        assert (crop.max() == 0) == outside
