from fractions import Fraction
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import av
import cv2
import numpy as np
import pytest

from re3.video import SourceError, VideoWriter, open_source


def level(index):
    """Brightness that stands for a frame's number and survives compression."""
    return 20 + 10 * index


@pytest.fixture
def clip(tmp_path):
    path = tmp_path / "clip.mp4"
    with VideoWriter(path, Fraction(30000, 1001), (64, 48)) as writer:
        for index in range(20):
            writer.write(np.full((48, 64, 3), level(index), np.uint8))
    return path


def numbers(source):
    return [(frame.index, round((frame.image.mean() - 20) / 10)) for frame in source]


@pytest.mark.parametrize("start", [0, 1, 7, 19])
def test_frames_are_exact(clip, start):
    with open_source(clip, start_frame=start) as source:
        assert numbers(source) == [(i, i) for i in range(start, 20)]


def test_what_a_source_says_of_itself(clip):
    with open_source(clip) as source:
        assert (source.name, source.size, source.frame_count) == ("clip.mp4", (64, 48), 20)
        assert source.fps == Fraction(30000, 1001)
        times = [frame.timestamp for frame in source]
    np.testing.assert_allclose(times, np.arange(20) * 1001 / 30000, atol=1e-4)


def test_images_come_in_natural_order_and_may_differ_in_size(tmp_path):
    for index in (10, 2, 1):
        cv2.imwrite(str(tmp_path / f"img{index}.png"), np.full((8 + index, 9, 3), index, np.uint8))
    (tmp_path / "notes.txt").write_text("not an image")
    for spec in (tmp_path, str(tmp_path / "*.png")):
        with open_source(spec) as source:
            frames = list(source)
        assert [int(frame.image[0, 0, 0]) for frame in frames] == [1, 2, 10]
        assert [frame.index for frame in frames] == [0, 1, 2]
        assert frames[1].timestamp == pytest.approx(1 / 30)


def test_a_sideways_recording_is_turned_upright(tmp_path):
    path = tmp_path / "sideways.mp4"
    image = np.zeros((32, 64, 3), np.uint8)
    image[:, :32] = 255
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 32, "yuv420p"
        try:
            stream.set_display_rotation(90)
        except AttributeError:
            pytest.skip("this PyAV cannot write a rotation")
        for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")):
            container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    with open_source(path) as source:
        assert source.size == (32, 64)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: p / "none.mp4", "does not exist; expected a video file, a folder"),
        (lambda p: str(p / "*.jpg"), "no file matches"),
        (lambda p: p, "holds no images"),
        (lambda p: _write(p / "text.mp4", b"hello"), "cannot be opened as a video"),
        (lambda p: _write(p / "empty.mp4", b""), "cannot be opened as a video"),
        (lambda p: _write(p / "broken.png", b"hello"), "cannot be read as an image"),
        (lambda p: "http://127.0.0.1:9/nothing", "cannot be opened as a video"),
    ],
)
def test_what_cannot_be_opened_is_named(tmp_path, make, message):
    with pytest.raises(SourceError, match=message):
        open_source(make(tmp_path))


def _write(path, content):
    path.write_bytes(content)
    return path


def test_a_start_past_the_end_is_refused(clip, tmp_path):
    with pytest.raises(SourceError, match=r"no frame 20; it ends before, after 20 frames"):
        open_source(clip, start_frame=20)
    with pytest.raises(SourceError, match="start frame is -1"):
        open_source(clip, start_frame=-1)
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(SourceError, match=r"no frame 3.*1 images"):
        open_source(str(tmp_path / "*.png"), start_frame=3)


def test_a_stream_over_http(clip):
    handler = partial(SimpleHTTPRequestHandler, directory=str(clip.parent))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        with open_source(f"http://127.0.0.1:{server.server_port}/clip.mp4") as source:
            assert numbers(source) == [(i, i) for i in range(20)]
        server.shutdown()


def test_no_camera_is_said_clearly():
    with pytest.raises(SourceError, match="camera 97 cannot be opened"):
        open_source(97)


def test_a_broken_image_in_the_middle_is_named(tmp_path):
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((4, 4, 3), np.uint8))
    (tmp_path / "2.png").write_bytes(b"broken")
    with open_source(tmp_path) as source:
        frames = iter(source)
        next(frames)
        with pytest.raises(SourceError, match=r"2\.png cannot be read"):
            next(frames)
