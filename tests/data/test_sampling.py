"""Decoded frames on disk, and clips drawn from tracks."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from re3.data.frame_store import FrameStore
from re3.data.sampling import ClipSampler
from re3.data.sampling_config import SamplingConfig
from re3.data.sequence import Sequence
from re3.video import VideoWriter


@pytest.fixture
def video(tmp_path):
    """Frame t has brightness 20 + 7 t; 30 frames of 96 x 64."""
    path = tmp_path / "clip.mp4"
    with VideoWriter(path, 25, (96, 64)) as writer:
        for t in range(30):
            writer.write(np.full((64, 96, 3), 20 + 7 * t, np.uint8))
    return path


def track(video, frames=30, **changes):
    boxes = np.array([[10.0 + t, 20.0, 30.0, 20.0] for t in range(frames)])
    return Sequence(**{"name": "clip", "source": video, "boxes_xywh": boxes, **changes})


def number(crop):
    return round((float(crop.mean()) - 20) / 7)


PLAIN = SamplingConfig(mirrored=0.0, reversed=0.0, strides=(1,), leaps=0.0)


def test_the_store_decodes_once_and_maps_afterwards(video, tmp_path):
    frames, scale = FrameStore(tmp_path / "store").frames(video)
    assert frames.shape == (30, 64, 96, 3)
    assert scale == 1.0
    assert [number(frame) for frame in frames] == list(range(30))
    (kept,) = (tmp_path / "store").iterdir()
    before = kept.stat().st_mtime_ns
    again, _ = FrameStore(tmp_path / "store").frames(video)
    assert kept.stat().st_mtime_ns == before
    np.testing.assert_array_equal(again, frames)


def test_threads_may_ask_the_store_at_once(video, tmp_path):
    store = FrameStore(tmp_path / "store")
    with ThreadPoolExecutor(4) as pool:
        asked = list(pool.map(lambda _: store.frames(video), range(4)))
    assert all(frames is asked[0][0] for frames, _ in asked)
    assert len(list((tmp_path / "store").iterdir())) == 1


def test_the_store_shrinks_large_frames(video, tmp_path):
    frames, scale = FrameStore(tmp_path / "store", longest_side=48).frames(video)
    assert frames.shape == (30, 32, 48, 3)
    assert scale == 0.5


@pytest.mark.parametrize("seed", range(5))
def test_boxes_belong_to_their_frames(video, tmp_path, seed):
    sampler = ClipSampler([track(video)], [], FrameStore(tmp_path / "store"), PLAIN)
    recorded = sampler._recorded(6, False, np.random.default_rng(seed))
    for t in range(6):
        shown = number(recorded.crop(t, (0, 0, 96, 64), 64))
        np.testing.assert_allclose(recorded.boxes_xyxy[t], (10 + shown, 20, 40 + shown, 40))


@pytest.mark.parametrize("seed", range(8))
def test_a_clip_that_leaps_starts_long_before_or_after_its_other_frames(video, tmp_path, seed):
    config = replace(PLAIN, leaps=1.0, leap_frames=(10, 15))
    sampler = ClipSampler([track(video)], [], FrameStore(tmp_path / "store"), config)
    clip = sampler._recorded(4, True, np.random.default_rng(seed))
    assert clip.leaps
    shown = [number(clip.crop(t, (0, 0, 96, 64), 64)) for t in range(4)]
    assert np.diff(shown[1:]).tolist() == [1, 1]
    leap = abs(shown[1] - shown[0])
    assert 10 <= leap <= 15 or shown[0] in (0, 29)  # cut short by the end of the track
    for t in range(4):
        np.testing.assert_allclose(clip.boxes_xyxy[t], (10 + shown[t], 20, 40 + shown[t], 40))


def test_a_clip_leaps_only_where_the_object_is_seen_on_both_sides(video, tmp_path):
    boxes = np.array(track(video).boxes_xywh)
    boxes[::2] = np.nan
    config = replace(PLAIN, leaps=0.5)
    sparse = track(video, boxes_xywh=boxes)
    sampler = ClipSampler([sparse], [], FrameStore(tmp_path / "store"), config)
    clips = [sampler.sample(4, np.random.default_rng(seed)) for seed in range(40)]
    leaping = [clip for clip in clips if clip.leaps]
    assert 8 <= len(leaping) <= 32
    assert not any(np.isnan(clip.boxes_xyxy[0]).any() for clip in clips)
    assert not any(np.isnan(clip.boxes_xyxy[1]).any() for clip in leaping)


def test_a_late_track_reads_its_own_frames(video, tmp_path):
    late = track(video, frames=10, start_frame=15)
    sampler = ClipSampler([late], [], FrameStore(tmp_path / "store"), PLAIN)
    recorded = sampler._recorded(10, False, np.random.default_rng(0))
    shown = [number(recorded.crop(t, (0, 0, 96, 64), 64)) for t in range(10)]
    assert shown == list(range(15, 25))


def test_a_short_track_is_repeated_at_its_end(video, tmp_path):
    short = track(video, frames=3)
    sampler = ClipSampler([short], [], FrameStore(tmp_path / "store"), PLAIN)
    assert len(sampler.sample(8, np.random.default_rng(0)).boxes_xyxy) == 8


def test_the_object_is_there_in_the_first_frame(video, tmp_path):
    boxes = np.full((30, 4), np.nan)
    boxes[[4, 20, 21]] = (10, 20, 30, 20)
    gaps = track(video, boxes_xywh=boxes)
    sampler = ClipSampler([gaps], [], FrameStore(tmp_path / "store"))
    for seed in range(10):
        clip = sampler.sample(5, np.random.default_rng(seed))
        assert not np.isnan(clip.boxes_xyxy[0]).any()


def test_the_same_generator_gives_the_same_clip(video, tmp_path):
    sampler = ClipSampler([track(video)], [], FrameStore(tmp_path / "store"))
    a, b = (sampler.sample(4, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(a.boxes_xyxy, b.boxes_xyxy)
    np.testing.assert_array_equal(a.crop(2, (0, 0, 50, 50), 32), b.crop(2, (0, 0, 50, 50), 32))


def test_nothing_to_draw_from_is_refused(video, tmp_path):
    tiny = track(video, boxes_xywh=np.tile([5.0, 5.0, 2.0, 2.0], (30, 1)))
    with pytest.raises(ValueError, match="nothing to train on: of 1 tracks none"):
        ClipSampler([tiny], [], FrameStore(tmp_path / "store"))


def test_what_is_outside_the_frame_may_be_another_colour(video, tmp_path):
    sampler = ClipSampler([track(video)], [], FrameStore(tmp_path / "s"), PLAIN)
    black = sampler.with_fill((0.0, 0.0, 0.0))
    assert black.config.simulation.fill == (0.0, 0.0, 0.0)
    assert sampler.config.fill == (127.0, 127.0, 127.0)
    clip = black.sample(2, np.random.default_rng(0))
    assert clip.crop(0, (-300.0, -300.0, -200.0, -200.0), 32).max() < 40
