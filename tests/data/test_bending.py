"""Cut-outs that change their shape."""

from itertools import pairwise

import cv2
import numpy as np

from re3.data.bending import MARGIN, bend, with_margin


def disc():
    image = np.full((60, 80, 3), 200, np.uint8)
    alpha = np.zeros((60, 80), np.uint8)
    cv2.ellipse(alpha, (40, 30), (39, 29), 0, 0, 360, 255, -1)
    return with_margin(image, alpha)


def test_the_margin_is_transparent_on_all_sides():
    image, alpha = disc()
    assert (
        image.shape[:2] == alpha.shape == (60 + 2 * round(60 * MARGIN), 80 + 2 * round(80 * MARGIN))
    )
    edges = (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1])
    assert not any(edge.any() for edge in edges)


def test_shapes_change_smoothly_and_keep_their_size():
    image, alpha = disc()
    bent = [
        look[1].astype(int)
        for look in bend(image, alpha, np.arange(30), 0.05, np.random.default_rng(1))
    ]
    areas = np.array([(a > 127).sum() for a in bent]) / (alpha > 127).sum()
    assert ((areas > 0.6) & (areas < 1.6)).all()
    step = np.mean([np.abs(a - b).mean() for a, b in pairwise(bent)])
    whole = max(np.abs(a - bent[0]).mean() for a in bent)
    assert 0 < step < 0.5 * whole


def test_without_strength_nothing_bends():
    image, alpha = disc()
    for bent_image, bent_alpha in bend(image, alpha, np.arange(3), 0.0, np.random.default_rng(0)):
        np.testing.assert_array_equal(bent_image, image)
        np.testing.assert_array_equal(bent_alpha, alpha)
