import os
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
    ],
)
def test_unusable_arguments_are_refused(tmp_path, name, fps, size, message):
    with pytest.raises(ValueError, match=message):
        VideoWriter(tmp_path / name, fps, size)
