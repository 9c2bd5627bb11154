import errno
import os
import subprocess
import sys
from contextlib import nullcontext
from fractions import Fraction

import av
import numpy as np
import pytest

from re3.video import VideoWriter, open_source


def write(path, frames, size=(64, 48), fps=25):
    with VideoWriter(path, fps, size) as writer:
        for index in range(frames):
            writer.write(np.full((size[1], size[0], 3), 10 * index, np.uint8))


@pytest.mark.parametrize("fps", [Fraction(30000, 1001), 12.5, 10])
def test_what_is_written_plays_in_a_browser(tmp_path, fps):
    write(tmp_path / "v.mp4", 5, fps=fps)
    with av.open(str(tmp_path / "v.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert (stream.width, stream.height) == (64, 48)
        assert stream.average_rate == Fraction(fps)
        assert sum(1 for _ in container.decode(video=0)) == 5


@pytest.mark.parametrize(("cores", "threads"), [(1, 1), (2, 1), (4, 3)])
def test_encoding_leaves_a_core_to_tracking(tmp_path, monkeypatch, cores, threads):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)), raising=False)
    write(tmp_path / "v.mp4", 3, size=(640, 480))
    # x264 notes its settings in the stream.
    assert b" threads=%d " % threads in (tmp_path / "v.mp4").read_bytes()


def test_odd_sizes_get_one_more_line(tmp_path):
    write(tmp_path / "v.mp4", 2, size=(63, 47))
    with open_source(tmp_path / "v.mp4") as source:
        assert source.size == (64, 48)


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (17, 16), (640, 360)])
def test_every_size_can_be_written_and_keeps_its_pixels(tmp_path, size):
    image = np.full((size[1], size[0], 3), 90, np.uint8)
    image[-1:] = 160
    with VideoWriter(tmp_path / "v.mp4", 25, size) as writer:
        writer.write(image)
    with open_source(tmp_path / "v.mp4") as source:
        (frame,) = source
    np.testing.assert_allclose(frame.image[: size[1], : size[0]], image, atol=12)


def test_colours_are_kept_and_named(tmp_path):
    colours = [(0, 0, 255), (0, 255, 0), (255, 0, 0), (255, 255, 0), (128, 128, 128), (20, 90, 200)]
    image = np.repeat(np.array(colours, np.uint8), 32, axis=0)[None].repeat(64, axis=0)
    with VideoWriter(tmp_path / "v.mp4", 25, (image.shape[1], 64)) as writer:
        writer.write(image)
    with open_source(tmp_path / "v.mp4") as source:
        (frame,) = source
    np.testing.assert_allclose(frame.image[32, 16::32], colours, atol=8)
    with av.open(str(tmp_path / "v.mp4")) as container:
        context = container.streams.video[0].codec_context
        assert (context.colorspace, context.color_range) == (1, 1)  # BT.709, limited


def test_frames_of_another_shape_get_black_bars(tmp_path):
    with VideoWriter(tmp_path / "v.mp4", 25, (64, 48)) as writer:
        writer.write(np.full((200, 100, 3), 200, np.uint8))
    with open_source(tmp_path / "v.mp4") as source:
        (frame,) = source
    row = frame.image[24].mean(axis=-1)
    assert (row[:16] < 20).all()
    assert (row[24:40] > 180).all()
    assert (row[-16:] < 20).all()


def test_frames_of_another_size_are_scaled(tmp_path):
    with VideoWriter(tmp_path / "v.mp4", 25, (64, 48)) as writer:
        writer.write(np.zeros((48, 64, 3), np.uint8))
        writer.write(np.zeros((99, 31, 3), np.uint8))
    with open_source(tmp_path / "v.mp4") as source:
        assert [frame.image.shape for frame in source] == [(48, 64, 3)] * 2


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_what_was_written_before_an_exception_is_finished(tmp_path, error):
    path = tmp_path / "v.mp4"
    with pytest.raises(error), VideoWriter(path, 25, (64, 48)) as writer:
        for _ in range(3):
            writer.write(np.zeros((48, 64, 3), np.uint8))
        raise error
    with open_source(path) as source:
        assert len(list(source)) == 3
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_appears_under_the_name_before_the_end_and_nothing_without_frames(tmp_path):
    path = tmp_path / "v.mp4"
    path.write_bytes(b"an older file")
    with VideoWriter(path, 25, (64, 48)) as writer:
        writer.write(np.zeros((48, 64, 3), np.uint8))
        assert path.read_bytes() == b"an older file"
    assert path.read_bytes() != b"an older file"
    with VideoWriter(tmp_path / "none.mp4", 25, (64, 48)):
        pass
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.mp4").write_bytes(b"an older file")
    (tmp_path / "link.mp4").symlink_to("real.mp4")
    write(tmp_path / "link.mp4", 2)
    assert (tmp_path / "link.mp4").is_symlink()
    with open_source(tmp_path / "real.mp4") as source:
        assert len(list(source)) == 2


def test_what_cannot_be_written_is_an_error_that_names_the_file(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OSError, match="file"):
        write(tmp_path / "file" / "v.mp4", 1)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((48, 64), np.uint8),  # grey
        np.zeros((48, 64, 3), np.float32),  # not bytes
        np.zeros((0, 64, 3), np.uint8),  # empty
    ],
)
def test_an_unusable_frame_is_refused(tmp_path, image):
    with (
        VideoWriter(tmp_path / "v.mp4", 25, (64, 48)) as writer,
        pytest.raises(ValueError, match=r"expected uint8 \[H, W, 3\], BGR"),
    ):
        writer.write(image)
    with pytest.raises(RuntimeError, match="outside the writer's `with` block"):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "fps", "size", "message"),
    [
        ("v.avi", 25, (64, 48), r"does not end in \.mp4"),
        ("v.mp4", 0, (64, 48), "unusable"),
        ("v.mp4", float("nan"), (64, 48), "unusable"),
        ("v.mp4", 25, (0, 48), "unusable"),
        ("v.mp4", 25, (16385, 48), "16385 x 48 pixels; H.264 is written up to 16384 a side"),
        ("v.mp4", 25, (48, 20000), "48 x 20000 pixels"),
    ],
)
def test_unusable_arguments_are_refused(tmp_path, name, fps, size, message):
    with pytest.raises(ValueError, match=message):
        VideoWriter(tmp_path / name, fps, size)


@pytest.mark.parametrize(
    ("fps", "times"),
    [
        (12, [0, 1 / 12, 0.5, 1.0, 1.5, 3.0]),
        (Fraction(288, 53), [0, 0.083333, 0.166667, 1.0, 2.5, 3.0]),  # a rate that is a mean
        (Fraction(30000, 1001), [5.0, 5.04, 5.041, 9.0]),  # the first frame is at 0
        (25, [0, 3600.0, 36000.0]),
    ],
)
@pytest.mark.parametrize("live", [False, True])
def test_frames_have_the_times_that_they_were_given(tmp_path, fps, times, live):
    with VideoWriter(tmp_path / "v.mp4", fps, (64, 48), live=live) as writer:
        for time in times:
            writer.write(np.zeros((48, 64, 3), np.uint8), time)
    with open_source(tmp_path / "v.mp4") as source:
        read = [frame.timestamp for frame in source]
    np.testing.assert_allclose(read, np.array(times) - times[0], atol=1.1e-3)


@pytest.mark.parametrize("fps", [24, Fraction(30000, 1001), 59.94])
def test_times_rounded_to_milliseconds_keep_the_rate(tmp_path, fps):
    rate = Fraction(fps).limit_denominator(100_000)
    with VideoWriter(tmp_path / "v.mp4", fps, (64, 48)) as writer:
        for index in range(30):
            writer.write(np.zeros((48, 64, 3), np.uint8), round(float(index / rate), 3))
    with av.open(str(tmp_path / "v.mp4")) as container:
        assert container.streams.video[0].average_rate == rate


def test_times_that_do_not_rise_are_made_to(tmp_path):
    with VideoWriter(tmp_path / "v.mp4", 25, (64, 48)) as writer:
        for time in (0.0, 0.04, 0.04, 0.03, 0.12):
            writer.write(np.zeros((48, 64, 3), np.uint8), time)
    with open_source(tmp_path / "v.mp4") as source:
        read = [frame.timestamp for frame in source]
    np.testing.assert_allclose(read, [0, 0.04, 0.041, 0.042, 0.12], atol=1e-3)


@pytest.mark.parametrize("live", [False, True])
def test_the_shape_of_pixels_is_passed_on(tmp_path, live):
    path = tmp_path / "v.mp4"
    with VideoWriter(path, 25, (64, 48), pixel_aspect=Fraction(16, 11), live=live) as writer:
        writer.write(np.zeros((48, 64, 3), np.uint8))
    with open_source(path) as source:
        assert (source.size, source.pixel_aspect) == ((64, 48), Fraction(16, 11))


def test_a_live_video_plays_where_the_process_is_killed_and_is_ordinary_at_the_end(tmp_path):
    path = tmp_path / "v.mp4"
    path.write_bytes(b"an older file")
    code = (
        "import os, sys, numpy as np\n"
        "from re3.video import VideoWriter\n"
        "with VideoWriter(sys.argv[1], 25, (64, 48), live=True) as writer:\n"
        "    for index in range(60):\n"
        "        writer.write(np.full((48, 64, 3), 4 * index, np.uint8))\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    assert subprocess.run([sys.executable, "-c", code, path], check=False).returncode == -9
    with open_source(path) as source:
        frames = list(source)
    assert 30 < len(frames) < 60
    levels = [frame.image.mean() for frame in frames]
    np.testing.assert_allclose(levels, 4 * np.arange(len(frames)), atol=3)
    assert list(tmp_path.iterdir()) == [path]

    with VideoWriter(path, 25, (64, 48), live=True) as writer:
        for index in range(60):
            writer.write(np.full((48, 64, 3), 4 * index, np.uint8))
    data = path.read_bytes()
    assert b"moof" not in data
    assert data.index(b"moov") < data.index(b"mdat")  # plays before it is there to its end
    with open_source(path) as source:
        assert (source.frame_count, len(list(source))) == (60, 60)
    assert list(tmp_path.iterdir()) == [path]


def test_a_live_video_without_frames_leaves_an_older_file(tmp_path):
    path = tmp_path / "v.mp4"
    path.write_bytes(b"an older file")
    with VideoWriter(path, 25, (64, 48), live=True):
        pass
    assert path.read_bytes() == b"an older file"


@pytest.mark.parametrize(("number", "error"), [(errno.ENOSPC, None), (errno.EIO, OSError)])
def test_a_live_video_stays_fragmented_where_there_is_no_room_for_a_copy(
    tmp_path, monkeypatch, number, error
):
    def fail(fragmented, whole):
        whole.write_bytes(b"a part")
        raise OSError(number, "fails")

    monkeypatch.setattr("re3.video.writer._rewrite", fail)
    path = tmp_path / "v.mp4"
    writer = VideoWriter(path, 25, (64, 48), live=True)
    with pytest.raises(error) if error else nullcontext(), writer:
        writer.write(np.zeros((48, 64, 3), np.uint8))
    with open_source(path) as source:
        assert len(list(source)) == 1
    assert list(tmp_path.iterdir()) == [path]
