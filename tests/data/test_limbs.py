"""Cut-outs with limbs that swing."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from re3.data.bending import with_margin
from re3.data.limbs import MARGIN, swing_limbs

TIMES = np.arange(40)


def figure():
    """A body with two arms, each of a colour of its own."""
    image = np.full((90, 60, 3), 90, np.uint8)
    alpha = np.zeros((90, 60), np.uint8)
    cv2.ellipse(alpha, (30, 45), (14, 44), 0, 0, 360, 255, -1)
    cv2.rectangle(alpha, (0, 26), (59, 34), 255, -1)
    image[:, :16], image[:, 44:] = (0, 0, 250), (250, 0, 0)
    return with_margin(image, alpha, MARGIN)


def swung(seed):
    image, alpha = figure()
    return swing_limbs(image, alpha, TIMES, np.random.default_rng(seed))


def box_of(alpha):
    return np.array(cv2.boundingRect((alpha > 127).astype(np.uint8)), float)


@pytest.mark.parametrize("seed", range(5))
def test_the_object_stays_in_one_piece_and_nearly_as_large(seed):
    whole = (figure()[1] > 127).sum()
    for _, alpha in swung(seed):
        opaque = (alpha > 127).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(opaque)
        assert stats[1:, cv2.CC_STAT_AREA].max() > 0.9 * opaque.sum()
        assert 0.5 * whole < opaque.sum() < 1.2 * whole


def test_its_box_changes_and_smoothly():
    changes, steps = [], []
    for seed in range(8):
        boxes = np.array([box_of(alpha) for _, alpha in swung(seed)])
        changes.append(np.ptp(boxes[:, 2:], axis=0).max())
        steps.append(max(np.abs(a - b).max() for a, b in pairwise(boxes)))
    assert np.median(changes) > 8  # of 60 x 90 pixels
    assert max(steps) < 40
    assert np.median(steps) < 0.75 * np.median(changes)


def test_limbs_keep_their_colours():
    reds = [((image[:, :, 2] > 200) & (alpha > 127)).sum() for image, alpha in swung(0)]
    image, alpha = figure()
    expected = ((image[:, :, 2] > 200) & (alpha > 127)).sum()
    assert min(reds) > 0.3 * expected
    assert max(reds) < 1.3 * expected


def test_the_same_seed_gives_the_same_clip():
    for (image, alpha), (again, alpha_again) in zip(swung(3), swung(3), strict=True):
        np.testing.assert_array_equal(image, again)
        np.testing.assert_array_equal(alpha, alpha_again)
    assert any((a != b).any() for (_, a), (_, b) in zip(swung(3), swung(4), strict=True))


def test_an_object_of_a_few_pixels_stays_as_it_is():
    image, alpha = np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), np.uint8)
    alpha[3:5, 3:5] = 255
    for _, swung_alpha in swing_limbs(image, alpha, TIMES, np.random.default_rng(0)):
        np.testing.assert_array_equal(swung_alpha, alpha)
