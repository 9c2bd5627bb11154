import functools
import http.server
import re
import socket
import threading
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from re3.video import FirstFrameKept, SourceError, VideoWriter, open_source


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


@pytest.fixture
def noise(tmp_path):
    """A clip that cannot be compressed to nothing, so that damage hits frames."""
    path = tmp_path / "noise.mp4"
    random = np.random.default_rng(0)
    with VideoWriter(path, 25, (64, 48)) as writer:
        for _ in range(40):
            writer.write(random.integers(0, 255, (48, 64, 3), np.uint8))
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


def test_images_of_one_folder_stay_together_and_hidden_files_are_left_out(tmp_path):
    for folder, index in (("b", 1), ("a", 10), ("a", 9)):
        (tmp_path / folder).mkdir(exist_ok=True)
        image = np.full((8, 8, 3), index, np.uint8)
        cv2.imwrite(str(tmp_path / folder / f"{index}.png"), image)
    (tmp_path / "a" / "._9.png").write_bytes(b"what a file manager leaves behind")
    (tmp_path / "a" / "Thumbs.db").write_bytes(b"another")
    with open_source(str(tmp_path / "*" / "*")) as source:
        assert [int(frame.image[0, 0, 0]) for frame in source] == [9, 10, 1]
    with open_source(tmp_path / "a") as source:
        assert source.frame_count == 2


def test_digits_are_a_camera_but_a_path_of_digits_is_a_path(tmp_path, monkeypatch):
    (tmp_path / "97").mkdir()
    cv2.imwrite(str(tmp_path / "97" / "1.png"), np.zeros((8, 8, 3), np.uint8))
    monkeypatch.chdir(tmp_path)
    with open_source(Path("97")) as source:
        assert source.frame_count == 1
    with pytest.raises(SourceError, match="camera 97"):
        open_source("97")


def test_a_source_is_walked_once_and_gives_nothing_when_closed(clip):
    with open_source(clip) as source:
        walked = iter(source)
        assert next(walked).index == 0
        assert next(walked).index == 1
    assert list(walked) == []
    assert list(source) == []


def test_the_first_frame_can_be_looked_at_before_the_walk(clip):
    with open_source(clip) as plain, FirstFrameKept(open_source(clip)) as kept:
        assert (kept.fps, kept.size, kept.frame_count) == (plain.fps, plain.size, plain.frame_count)
        assert kept.first.index == 0
        assert numbers(kept) == numbers(plain)


class FakeCamera:
    """Stands for cv2.VideoCapture: five frames, then unplugged."""

    def __init__(self, index):
        self.frames = [] if index == 1 else [np.full((6, 8, 3), i, np.uint8) for i in range(5)]

    def isOpened(self):
        return True

    def get(self, prop):
        return 0.0

    def read(self):
        return (True, self.frames.pop(0)) if self.frames else (False, None)

    def release(self):
        pass


def test_a_camera_gives_frames_until_it_stops(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", FakeCamera)
    given = []
    with open_source("0", start_frame=2) as source:
        assert (source.name, source.size, source.fps) == ("camera 0", (8, 6), 30)
        assert source.frame_count is None
        with pytest.raises(SourceError, match="camera 0 gave 5 frames and then none"):
            for frame in source:
                given.append((frame.index, int(frame.image[0, 0, 0])))
                assert 0 <= frame.timestamp < 60
    assert given == [(2, 2), (3, 3), (4, 4)]
    with pytest.raises(SourceError, match="camera 1 gave 0 frames"):
        open_source(1)


@pytest.fixture
def served(tmp_path):
    """The address of a web server for the folder."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    handler = functools.partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_stream_is_read_and_its_password_not_shown(clip, served):
    with open_source(f"http://me:secret@{served}/clip.mp4", start_frame=3) as source:
        assert source.name == f"http://{served}/clip.mp4"
        assert numbers(source) == [(i, i) for i in range(3, 20)]
    with pytest.raises(SourceError, match=re.escape(f"http://{served}/none.mp4 cannot")) as error:
        open_source(f"http://me:secret@{served}/none.mp4")
    assert "secret" not in str(error.value)


def test_a_stream_goes_on_after_a_damaged_packet(noise, served):
    data = bytearray(noise.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 500] = bytes(i * 37 % 256 for i in range(500))
    noise.write_bytes(data)
    with open_source(f"http://{served}/noise.mp4") as source:
        indices = [frame.index for frame in source]
    assert indices == list(range(len(indices)))
    assert len(indices) > 20


def test_a_file_with_its_index_at_the_end_needs_a_server_that_can_seek(tmp_path, served):
    with av.open(str(tmp_path / "late.mp4"), "w") as container:  # the index comes last by default
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        rng = np.random.default_rng(0)
        for _ in range(30):  # larger than what FFmpeg reads ahead
            picture = rng.integers(0, 256, (120, 160, 3), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode())
    with pytest.raises(SourceError, match=r"gives no frame: .*answers range requests"):
        open_source(f"http://{served}/late.mp4")


def test_a_silent_stream_is_given_up(monkeypatch):
    monkeypatch.setattr("re3.video.containers.STREAM_TIMEOUT", 1.0)
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        pytest.raises(SourceError, match="nothing came for 1 seconds"),
    ):
        open_source(f"http://127.0.0.1:{server.getsockname()[1]}/clip.mp4")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: p / "none.mp4", "does not exist; expected a video file, a folder"),
        (lambda p: str(p / "*.jpg"), "no file matches"),
        (lambda p: _write(p / "clip1.mp4", b"").with_name("clip.mp4"), "did you mean .*clip1"),
        (lambda p: p / "nowhere" / "clip.mp4", "nor does the folder"),
        (lambda p: _write(p / "a.mp4", b"").with_name("*.mp4"), "none of the 1 files .* an image"),
        (lambda p: _write(p / "empty.png", b""), "an empty file"),
        (lambda p: p, "holds no images"),
        (lambda p: _write(p / "text.mp4", b"hello"), "cannot be opened as a video"),
        (lambda p: _write(p / "empty.mp4", b""), "cannot be opened as a video"),
        (lambda p: _write(p / "broken.png", b"hello"), "cannot be read as an image"),
        (lambda p: "http://127.0.0.1:9/nothing", "cannot be opened as a video"),
        (lambda p: "HTTP://127.0.0.1:9/nothing", "Connection refused|cannot be opened as a video"),
        (lambda p: "tcp://127.0.0.1:9", "cannot be opened as a video"),
        (lambda p: "foo://me:secret@host/x", r"foo://host/x begins with foo://; .*rtsp://.*srt://"),
        (lambda p: "", "the source is empty"),
        (lambda p: -1, "camera index is -1; expected 0"),
        (lambda p: "-2", "camera index is -2; expected 0"),
        (lambda p: "100", "camera index is 100; expected 0"),
        (lambda p: 10**12, "camera index is 10+; expected 0"),
    ],
)
def test_what_cannot_be_opened_is_named(tmp_path, make, message):
    with pytest.raises(SourceError, match=message):
        open_source(make(tmp_path))


def _write(path, content):
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", ["2024-05-01T12:30:00.mp4", "a:b.mp4", "http:x.mp4", "100%.mp4"])
def test_a_name_with_a_colon_is_a_file(clip, tmp_path, monkeypatch, name):
    clip.rename(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    for spec in (name, Path(name), f"file://{tmp_path / name}".replace("%", "%25")):
        with open_source(spec) as source:
            assert numbers(source) == [(i, i) for i in range(20)]


def test_a_start_past_the_end_is_refused(clip, tmp_path):
    with pytest.raises(SourceError, match=r"no frame 20; it ends before, after 20 frames"):
        open_source(clip, start_frame=20)
    with pytest.raises(SourceError, match="start frame is -1"):
        open_source(clip, start_frame=-1)
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(SourceError, match=r"no frame 3.*1 images"):
        open_source(str(tmp_path / "*.png"), start_frame=3)


def test_no_camera_is_said_clearly_and_by_nobody_else(capfd):
    with pytest.raises(SourceError, match="camera 97 cannot be opened"):
        open_source(97)
    assert capfd.readouterr() == ("", "")


def test_a_broken_image_in_the_middle_is_named(tmp_path):
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((4, 4, 3), np.uint8))
    (tmp_path / "2.png").write_bytes(b"broken")
    with open_source(tmp_path) as source:
        frames = iter(source)
        next(frames)
        with pytest.raises(SourceError, match=r"2\.png cannot be read"):
            next(frames)


def test_frames_of_a_real_clip_are_exact_from_any_start(shared_data):
    clip = shared_data / "demo" / "cc-by" / "one-by-one-person-detection.mp4"
    wanted = 40
    with open_source(clip) as source:
        expected = next(frame for frame in source if frame.index == wanted)
    with open_source(clip, start_frame=wanted) as source:
        found = next(iter(source))
    assert found.index == wanted
    assert found.timestamp == expected.timestamp
    np.testing.assert_array_equal(found.image, expected.image)
