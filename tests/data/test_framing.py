"""Boxes about a part of the object, or about more than it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from re3.data.clip import FramedClip, RecordedClip
from re3.data.frame_store import FrameStore
from re3.data.framing import Framing, frame_otherwise
from re3.data.sampling import ClipSampler
from re3.data.sampling_config import SamplingConfig
from re3.data.sequence import Sequence
from re3.video import VideoWriter

PART = Framing((0.25, -0.25), (0.5, 0.5))
"""The upper right quarter."""
FRAMED = SamplingConfig(mirrored=0.0, reversed=0.0, strides=(1,), leaps=0.0, framed=1.0)


def test_a_framing_stays_where_it_is_in_boxes_that_move_and_grow():
    boxes = np.array([[0, 0, 40, 20], [100, 50, 180, 90], [np.nan] * 4])
    expected = [[20, 0, 40, 10], [140, 50, 180, 70], [np.nan] * 4]
    np.testing.assert_allclose(PART.of(boxes), expected)


def test_drawn_framings_lie_within_the_box_or_about_it():
    rng = np.random.default_rng(0)
    sides = []
    for _ in range(200):
        left, top, right, bottom = Framing.draw(0.35, rng).of([0, 0, 1, 1])
        for low, high in ((left, right), (top, bottom)):
            assert (low >= -1e-9 and high <= 1 + 1e-9) or (low <= 1e-9 and high >= 1 - 1e-9)
            sides.append(high - low)
    assert min(sides) < 0.6
    assert 1.3 < max(sides) < 1.66


def test_a_framed_clip_shows_the_same_pixels_and_ends_at_the_border():
    image = np.arange(60 * 80 * 3, dtype=np.uint32).astype(np.uint8).reshape(60, 80, 3)
    clip = RecordedClip(image[None], [[50.0, 10, 70, 30]], (0, 0, 0))
    framed = FramedClip(clip, np.array([[50.0, -5, 95, 30]]))
    np.testing.assert_array_equal(framed.boxes_xyxy, [[50, 0, 80, 30]])
    region = [40, 0, 80, 40]
    np.testing.assert_array_equal(framed.crop(0, region, 20), clip.crop(0, region, 20))


@pytest.fixture
def sample(tmp_path):
    """Draws a clip of four frames of a video of 96 x 64 with the boxes given."""
    path = tmp_path / "clip.mp4"
    with VideoWriter(path, 25, (96, 64)) as writer:
        for _ in range(4):
            writer.write(np.full((64, 96, 3), 90, np.uint8))

    def draw(boxes, seed, config=FRAMED):
        sequence = Sequence("clip", path, np.array(boxes))
        sampler = ClipSampler([sequence], [], FrameStore(tmp_path / "store"), config)
        return sampler.sample(4, np.random.default_rng(seed)).boxes_xyxy

    return draw


def test_clips_are_framed_otherwise_as_often_as_asked(sample):
    boxes = [[30.0 + t, 20, 20, 16] for t in range(4)]
    whole = np.array([[30.0 + t, 20, 50 + t, 36] for t in range(4)])
    for seed in range(5):
        drawn = sample(boxes, seed)
        assert not np.allclose(drawn, whole)
        np.testing.assert_allclose(np.diff(drawn, axis=0), [[1, 0, 1, 0]] * 3, atol=1e-6)
        never = sample(boxes, seed, replace(FRAMED, framed=0.0))
        np.testing.assert_allclose(never, whole)


def test_clips_whose_object_is_not_in_all_frames_keep_their_boxes(sample):
    boxes = [[30.0, 20, 20, 16], [30.0, 20, 20, 16], [np.nan] * 4, [30.0, 20, 20, 16]]
    for seed in range(5):
        assert np.allclose(sample(boxes, seed)[0], [30, 20, 50, 36])


@pytest.mark.parametrize(("key", "value"), [("framed", 1.5), ("framing", -0.1)])
def test_settings_that_make_no_sense_are_told(key, value):
    with pytest.raises(ValueError, match=key):
        SamplingConfig(**{key: value})


def test_sequences_framed_otherwise_keep_frames_and_lose_polygons():
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]])
    given = Sequence(
        "s", Path("v.mp4"), np.array([[0, 0, 10, 10.0]]), dataset="d", polygons=(square,)
    )
    made = frame_otherwise([given])
    assert {s.source for s in made} == {given.source}
    assert all(s.polygons is None and s.name == "s" for s in made)
    assert len({s.dataset for s in made}) == len(made) == 6
