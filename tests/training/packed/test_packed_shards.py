"""Shards: what goes in comes out, and what is no shard is refused."""

import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from re3.data.mix import Mix
from re3.data.packed.pack import PackConfig, pack
from re3.data.packed.shards import Shard, read_shards
from re3.data.sampling import Source
from re3.data.sequence import Sequence
from re3.video import open_source


def test_every_shard_is_complete_in_itself(packed, sources):
    shards = read_shards(packed)
    assert len(shards) > 1
    for shard in shards:
        assert [(s.name, s.kind, s.weight) for s in shard.index.sources] == [
            ("films", "videos", 2.0),
            ("pictures", "stills", 1.0),
        ]
        for video in shard.index.videos:
            assert sum(len(shard.decode_frames(file)) for file in video.files) == video.frames
        for still in shard.index.stills:
            picture, numbers = shard.decode_still(still)
            assert picture.shape == (still.height, still.width, 3)
            assert numbers.shape == (still.height, still.width)


def test_frames_and_boxes_of_a_track_come_back(packed, sources):
    (shard,) = [s for s in read_shards(packed) if s.index.videos]
    ((video,), (track,)) = shard.index.videos, shard.index.tracks
    assert (video.width, video.height, video.frames, len(video.files)) == (160, 96, 130, 2)
    given = sources[0].sequences[0]
    np.testing.assert_allclose(track.boxes_xywh, given.boxes_xywh, atol=0.01)
    with open_source(given.source) as source:
        frames = [frame.image[..., ::-1] for frame in source]
    read = np.concatenate([shard.decode_frames(file) for file in video.files])
    assert np.abs(read.astype(int) - np.stack(frames)).mean() < 3


def test_outlines_span_the_masks(packed, sources):
    for shard in read_shards(packed):
        for still in shard.index.stills:
            _, numbers = shard.decode_still(still)
            rows, columns = np.nonzero(numbers == 1)
            (outline,) = still.outlines
            assert outline.min(axis=0).tolist() == [columns.min(), rows.min()]
            assert outline.max(axis=0).tolist() == [columns.max() + 1, rows.max() + 1]


def test_large_frames_are_scaled_with_their_boxes(sources, tmp_path):
    config = PackConfig(longer_side=80, object_side=0)
    with ThreadPoolExecutor(1) as pool:
        pack(Mix(()), sources[:1], tmp_path, config, pool)
    (shard,) = read_shards(tmp_path)
    assert (shard.index.videos[0].width, shard.index.videos[0].height) == (80, 48)
    given = sources[0].sequences[0].boxes_xywh
    np.testing.assert_allclose(shard.index.tracks[0].boxes_xywh, given / 2, atol=0.01)


def test_small_objects_keep_their_pixels(sources, tmp_path):
    config = PackConfig(longer_side=80, object_side=18)  # objects are 24 pixels a side
    with ThreadPoolExecutor(1) as pool:
        pack(Mix(()), sources[:1], tmp_path, config, pool)
    assert read_shards(tmp_path)[0].index.videos[0].width == 120


def test_a_source_that_cannot_be_read_leaves_no_shard(sources, tmp_path):
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"nothing")
    bad = Source("bad", sequences=[Sequence("bad", broken, np.array([[1.0, 2, 3, 4]] * 3))])
    folder = tmp_path / "out"
    with ThreadPoolExecutor(1) as pool, pytest.raises(ValueError, match="broken"):
        pack(Mix(()), [*sources, bad], folder, PackConfig(shard_mb=0.01), pool)
    assert list(folder.iterdir()) == []


def test_a_folder_with_shards_is_not_written_into(packed, sources):
    with ThreadPoolExecutor(1) as pool, pytest.raises(FileExistsError, match="already"):
        pack(Mix(()), sources, packed, PackConfig(), pool)


def test_what_is_no_shard_is_refused(packed, tmp_path):
    with pytest.raises(FileNotFoundError, match="re3 data pack"):
        read_shards(tmp_path)
    cut = tmp_path / "shard-000.zip"
    cut.write_bytes(next(packed.glob("*.zip")).read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"shard-000\.zip"):
        Shard(cut)


def test_shards_of_two_mixes_are_refused(packed, sources, tmp_path):
    with ThreadPoolExecutor(1) as pool:
        pack(Mix(()), sources[:1], tmp_path, PackConfig(), pool)
    shutil.copy(next(packed.glob("*.zip")), tmp_path / "shard-900.zip")
    with pytest.raises(ValueError, match="different mixes"):
        read_shards(tmp_path)
