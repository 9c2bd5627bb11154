"""The decoder's process: the same frames as `re3 track`, and what it refuses or survives."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from re3.apps.server.decoder import Decoder
from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.remote_video import DecoderError, RemoteVideo
from re3.video import SourceError, VideoWriter, open_source
from re3.video.file_kinds import kind_of
from re3.video.seeking import SeekableSource

CLIP = Path(__file__).parents[3] / "examples" / "clips" / "person.mp4"


@pytest.fixture
def remote():
    video = RemoteVideo(Limits(duration_s=30, width=800, height=600))
    yield video
    video.close()


def write_clip(path, frames, size=(64, 48)):
    with VideoWriter(path, 25, size) as writer:
        for index in range(frames):
            writer.write(np.full((size[1], size[0], 3), index * 5 % 250, np.uint8))


def test_frames_are_those_of_the_command_line_in_any_order(remote):
    with open_source(CLIP) as source:
        frames = [frame for _, frame in zip(range(40), source, strict=False)]
    remote.open(CLIP)
    assert remote.size == (768, 432)
    assert remote.frame_count == 120
    for index in (0, 1, 2, 1, 30, 5, 39, 38, 0):
        frame = remote.read(index)
        assert (frame.index, frame.timestamp) == (index, frames[index].timestamp)
        np.testing.assert_array_equal(frame.image, frames[index].image)


def noisy_frames(count):
    rng = np.random.default_rng(1)
    image = rng.integers(0, 255, (48, 64, 3), np.uint8)
    return [np.roll(image, index, axis=1) for index in range(count)]


def write_with_b_frames(path, count, **options):
    """Keyframes every 12 frames, frames that refer to later ones, open GOPs if asked for."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", 25, options={"g": "12", "bf": "3", **options})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for image in noisy_frames(count):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")))
        container.mux(stream.encode())


def small_cache(path):
    decoder = Decoder(Limits(), cache_bytes=4 * 64 * 48 * 3)
    decoder.open(path)
    return decoder


@pytest.mark.parametrize("name", ["c.mp4", "c.mkv", "c.avi", "c.ts"])
@pytest.mark.parametrize("gop", ["closed", "open"])
def test_going_back_beyond_the_cache_gives_the_same_frames(tmp_path, name, gop):
    options = {"x264-params": "open-gop=1"} if gop == "open" else {}
    write_with_b_frames(tmp_path / name, 70, **options)
    with open_source(tmp_path / name) as source:
        frames = list(source)
    decoder = small_cache(tmp_path / name)
    for index in (0, 50, 20, 69, 3, 40, 41, 12, 66, 0, 24, 23):
        frame = decoder.read(index)
        np.testing.assert_array_equal(frame.image, frames[index].image)
        assert (frame.index, frame.timestamp) == (index, frames[index].timestamp)
    assert decoder.read(70) is None
    assert decoder.end == 70
    if name == "c.mp4":
        assert decoder._by_keyframes


def test_where_keyframes_lead_astray_the_file_is_decoded_from_its_beginning(tmp_path, monkeypatch):
    write_with_b_frames(tmp_path / "c.mp4", 70)
    decoder = small_cache(tmp_path / "c.mp4")
    frames = [decoder.read(index).image for index in range(70)]
    go_back = SeekableSource.go_back

    def astray(self, index):
        found = go_back(self, index)
        self._frames = (replace(f, image=255 - f.image) for f in list(self._frames))
        return found

    monkeypatch.setattr(SeekableSource, "go_back", astray)
    for index in (30, 5, 60):
        np.testing.assert_array_equal(decoder.read(index).image, frames[index])
    assert not decoder._by_keyframes


def test_the_end_is_told(remote, tmp_path):
    write_clip(tmp_path / "c.mp4", 3)
    remote.open(tmp_path / "c.mp4")
    assert remote.read(2).index == 2
    assert remote.read(3) is None
    assert remote.frame_count == 3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not one that can be tracked in"),
        (b"hello, this is text", "not one that can be tracked in; expected a video"),
        (b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n", "not one that can be tracked in"),
        (b"ffconcat version 1.0\nfile /etc/passwd\n", "not one that can be tracked in"),
        (CLIP.read_bytes()[:2000], "cannot be opened as a video"),
        (b"\xff\xd8\xff" + bytes(50), "cannot be read as an image"),
    ],
    ids=["empty", "text", "playlist", "list", "cut off", "half a picture"],
)
def test_what_is_no_video_is_refused_and_the_path_not_told(remote, tmp_path, content, message):
    path = tmp_path / "upload"
    path.write_bytes(content)
    with pytest.raises(SourceError, match=message) as told:
        remote.open(path)
    assert str(tmp_path) not in str(told.value)


def test_a_video_of_no_frames_is_refused(remote, tmp_path):
    path = tmp_path / "upload"
    whole = CLIP.read_bytes()
    start = whole.index(b"mdat") + 4
    path.write_bytes(whole[:start] + bytes(len(whole) - start))
    with pytest.raises(SourceError, match=r"no frame of it can be decoded|is broken"):
        remote.open(path)


def test_a_picture_is_a_video_of_one_frame(remote, tmp_path):
    cv2.imwrite(str(tmp_path / "p.png"), np.full((30, 40, 3), 7, np.uint8))
    remote.open(tmp_path / "p.png")
    assert remote.read(0).image[0, 0, 0] == 7
    assert remote.read(1) is None


def test_pictures_may_come_while_they_are_read(remote, tmp_path):
    for index in range(3):
        image = np.full((30, 40, 3), index, np.uint8)
        cv2.imwrite(str(tmp_path / f"{index:06d}.png"), image)
        if index == 0:
            remote.open(tmp_path, pictures=True)
        assert remote.read(index).image[0, 0, 0] == index
        assert remote.read(index + 1) is None
    assert remote.read(0).image[0, 0, 0] == 0
    (tmp_path / "000003.png").write_text("no picture")
    with pytest.raises(SourceError, match="has to be a JPEG, PNG or WebP"):
        remote.read(3)


@pytest.mark.parametrize("name", ["a.gif", "a.tif", "a.webp", "a.png"])
def test_all_frames_of_an_image_file_are_read_as_by_the_command(remote, tmp_path, name):
    path = tmp_path / name
    images = [np.full((24, 32, 3), 20 + 30 * index, np.uint8) for index in range(5)]
    if name == "a.tif":
        cv2.imwritemulti(str(path), images)
    elif not hasattr(cv2, "Animation"):
        pytest.skip("this OpenCV is older than 4.11 and writes no animations")
    else:
        made = cv2.Animation()
        made.frames = [np.dstack([each, np.full((24, 32), 255, np.uint8)]) for each in images]
        made.durations = [80] * 5
        cv2.imwriteanimation(str(path), made)
    remote.open(path)
    with open_source(path) as source:
        for frame in source:
            read = remote.read(frame.index)
            assert read.timestamp == frame.timestamp
            np.testing.assert_array_equal(read.image, frame.image)
    assert remote.read(5) is None
    assert round((remote.read(1).image.mean() - 20) / 30) == 1


def test_large_frames_and_long_videos_are_refused(remote, tmp_path):
    write_clip(tmp_path / "large.mp4", 2, (640, 802))
    with pytest.raises(OverLimitError, match=r"640 x 802 .*800 x 600 .*--max-resolution"):
        remote.open(tmp_path / "large.mp4")
    write_clip(tmp_path / "long.mp4", 25 * 31)
    with pytest.raises(OverLimitError, match=r"31 seconds long.*--max-duration"):
        remote.open(tmp_path / "long.mp4")


def test_frames_can_still_be_read_after_a_crash(remote):
    remote.open(CLIP)
    first = remote.read(0).image
    os.kill(remote.process_id, signal.SIGKILL)
    assert remote.read(49).index == 49
    np.testing.assert_array_equal(remote.read(0).image, first)


def test_a_frame_that_crashes_the_decoder_is_the_end(remote):
    remote.open(CLIP)
    first = remote.read(0).image
    restart = remote._restart

    def restart_and_hang():
        restart()
        os.kill(remote.process_id, signal.SIGSTOP)

    remote._answer_seconds, remote._restart = 0.3, restart_and_hang
    os.kill(remote.process_id, signal.SIGSTOP)
    with pytest.raises(DecoderError, match=r"crashed|no answer for 0\.3 seconds"):
        remote.read(50)
    remote._answer_seconds, remote._restart = 60, restart
    np.testing.assert_array_equal(remote.read(0).image, first)
    with pytest.raises(DecoderError):
        remote.read(50)


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (b"\x00\x00\x00\x18ftypmp42", "video"),
        (b"\x1a\x45\xdf\xa3", "video"),
        (b"RIFF\x00\x00\x00\x00AVI LIST", "video"),
        (b"RIFF\x00\x00\x00\x00WEBPVP8 ", "picture"),
        (b"RIFF\x00\x00\x00\x00WAVEfmt ", None),
        ((b"G" + bytes(187)) * 3, "video"),
        (b"G" + bytes(399), None),
        (b"\x89PNG\r\n\x1a\n", "picture"),
        (b"GIF89a", "video"),
        (b"II*\x00", "picture"),
        (b"MM\x00+", "picture"),
        (b"BM\x36\x10\x0e\x00\x00\x00\x00\x00", "picture"),
        (b"BM is no picture", None),
        ((b"\x00\x00\x00\x00G" + bytes(187)) * 2, "video"),  # M2TS
        (b"<html>", None),
        (b"v=0\r\no=- 0 0 IN IP4", None),
    ],
)
def test_files_are_known_by_their_beginning(head, kind):
    assert kind_of(head) == kind
