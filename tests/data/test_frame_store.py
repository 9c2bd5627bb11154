"""The bound of the cache of decoded frames."""

import errno
import os

import cv2
import numpy as np
import pytest

from re3.data.frame_store import ABANDONED, GIGABYTE, CacheFullError, FrameStore
from re3.video import VideoWriter

FRAME = 96 * 64 * 3
HEADER = 128


def video(folder, name, frames=10):
    path = folder / f"{name}.mp4"
    with VideoWriter(path, 25, (96, 64)) as writer:
        for t in range(frames):
            writer.write(np.full((64, 96, 3), 20 + 7 * t, np.uint8))
    return path


def images(folder, name, frames=10):
    path = folder / name
    path.mkdir(parents=True)
    for t in range(frames):
        cv2.imwrite(str(path / f"{t:03d}.png"), np.full((64, 96, 3), 20 + 7 * t, np.uint8))
    return path


def limited(folder, frames):
    """A store with room for so many frames of the clips above, and a header a clip of ten."""
    size = frames * FRAME + (frames // 10) * HEADER
    return FrameStore(folder / "store", limit_gb=size / GIGABYTE)


def kept(folder):
    return sorted(path.name.rpartition("-")[0] for path in (folder / "store").iterdir())


def numbers(frames):
    return [round((float(np.mean(frame)) - 20) / 7) for frame in frames]


def test_what_was_used_longest_ago_makes_room(tmp_path):
    a, b, c = (video(tmp_path, name) for name in "abc")
    store = limited(tmp_path, 20)
    store.frames(a)
    store.frames(b)
    store.frames(a)  # used again
    assert kept(tmp_path) == ["a", "b"]
    frames, _ = store.frames(c)
    assert kept(tmp_path) == ["a", "c"]
    assert numbers(frames) == list(range(10))
    # And comes back when it is asked for.
    assert numbers(store.frames(b)[0]) == list(range(10))
    assert kept(tmp_path) == ["b", "c"]
    assert sum(p.stat().st_size for p in (tmp_path / "store").iterdir()) <= store.limit


def test_frames_in_use_outlive_their_file(tmp_path):
    store = limited(tmp_path, 10)
    frames, _ = store.frames(video(tmp_path, "a"))
    store.frames(video(tmp_path, "b"))
    assert kept(tmp_path) == ["b"]
    assert numbers(frames) == list(range(10))


def test_a_file_that_another_process_removed_is_made_again(tmp_path):
    store = FrameStore(tmp_path / "store")
    path = video(tmp_path, "a")
    store.frames(path)
    (file,) = (tmp_path / "store").iterdir()
    file.unlink()
    assert numbers(store.frames(path)[0]) == list(range(10))
    assert kept(tmp_path) == ["a"]


@pytest.mark.parametrize("make", [video, images])
def test_a_clip_that_is_touched_or_moved_is_not_decoded_again(tmp_path, make):
    here = make(tmp_path, "a")
    FrameStore(tmp_path / "store").frames(here)
    (before,) = (tmp_path / "store").iterdir()
    os.utime(here, (1e9, 1e9))
    (tmp_path / "elsewhere").mkdir()
    there = here.rename(tmp_path / "elsewhere" / here.name)
    made = before.stat().st_mtime_ns
    FrameStore(tmp_path / "store").frames(there)
    assert list((tmp_path / "store").iterdir()) == [before]
    assert before.stat().st_mtime_ns == made


@pytest.mark.parametrize("make", [video, images])
def test_a_clip_that_is_changed_is_decoded_again(tmp_path, make):
    path = make(tmp_path, "a")
    FrameStore(tmp_path / "store").frames(path)
    make(tmp_path / "new", "a", frames=12)
    path.rename(tmp_path / "old")
    (tmp_path / "new" / path.name).rename(path)
    assert numbers(FrameStore(tmp_path / "store").frames(path)[0]) == list(range(12))


def test_a_video_larger_than_the_cache_is_told(tmp_path):
    store = limited(tmp_path, 10)
    with pytest.raises(CacheFullError, match=r"long\.mp4 takes .* may hold .*--cache-gb"):
        store.frames(video(tmp_path, "long", frames=15))
    assert list((tmp_path / "store").iterdir()) == []


def test_images_are_read_one_by_one_where_there_is_no_room_for_all(tmp_path):
    store = limited(tmp_path, 20)
    a, b = images(tmp_path, "a"), images(tmp_path, "b", frames=15)
    assert numbers(store.read(a, np.array([2, 5]))) == [2, 5]
    assert kept(tmp_path) == ["a"]
    # Past the end comes the last.
    assert numbers(store.read(b, np.array([14, 3, 99]))) == [14, 3, 14]
    assert kept(tmp_path) == ["a"]


def test_images_read_one_by_one_are_shrunk_as_stored_ones_are(tmp_path):
    folder = images(tmp_path, "a")
    stored = FrameStore(tmp_path / "store", longest_side=48)
    direct = FrameStore(tmp_path / "store2", longest_side=48, limit_gb=1e-9)
    indices = np.array([1, 4])
    np.testing.assert_array_equal(direct.read(folder, indices), stored.read(folder, indices))
    assert direct.scale(folder) == stored.scale(folder) == 0.5
    assert not (tmp_path / "store2").exists()


def test_a_full_disk_is_told_and_leaves_nothing_behind(tmp_path, monkeypatch):
    store = FrameStore(tmp_path / "store")
    path = video(tmp_path, "a")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(store, "_write", full)
    with pytest.raises(CacheFullError, match=r"a\.mp4 takes .* its disk has .*RE3_CACHE"):
        store.frames(path)
    assert list((tmp_path / "store").iterdir()) == []


def test_a_disk_that_is_nearly_full_makes_room(tmp_path, monkeypatch):
    a, b = video(tmp_path, "a"), video(tmp_path, "b")
    store = FrameStore(tmp_path / "store")
    store.frames(a)
    monkeypatch.setattr(store, "_free", lambda: 5 * FRAME)
    store.frames(b)
    assert kept(tmp_path) == ["b"]
    monkeypatch.setattr(store, "_free", lambda: -1)
    with pytest.raises(CacheFullError, match=r"c\.mp4 takes"):
        FrameStore._make_room(store, 100 * FRAME, tmp_path / "c.mp4")


def test_what_a_killed_process_left_is_removed(tmp_path):
    (tmp_path / "store").mkdir()
    old, new = tmp_path / "store" / "x.1.partial", tmp_path / "store" / "y.2.partial"
    for path in (old, new):
        path.write_bytes(b"half")
    long_ago = new.stat().st_mtime - 2 * ABANDONED
    os.utime(old, (long_ago, long_ago))
    FrameStore(tmp_path / "store").frames(video(tmp_path, "a"))
    assert not old.exists()
    assert new.exists()


def test_frames_of_several_sizes_are_told(tmp_path):
    folder = images(tmp_path, "a")
    cv2.imwrite(str(folder / "004.png"), np.zeros((60, 96, 3), np.uint8))
    with pytest.raises(ValueError, match=r"frame 4 has 96 x 60 pixels, but the first 96 x 64"):
        FrameStore(tmp_path / "store").frames(folder)
    assert list((tmp_path / "store").iterdir()) == []


@pytest.mark.parametrize("limit", [0, -1, float("nan")])
def test_a_limit_has_to_be_above_0(tmp_path, limit):
    with pytest.raises(ValueError, match="expected more than 0"):
        FrameStore(tmp_path, limit_gb=limit)
