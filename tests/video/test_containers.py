"""Recordings as phones, cameras and recorders leave them."""

import struct
from fractions import Fraction
from itertools import pairwise

import av
import numpy as np
import pytest
from av.bitstream import BitStreamFilterContext

from re3.video import FirstFrameKept, SourceError, open_source
from re3.video.timeline import Timeline

CORNERS = np.zeros((32, 64, 3), np.uint8)
CORNERS[:16, :32], CORNERS[:16, 32:], CORNERS[16:, :32] = 240, 160, 80
"""Each corner has its own brightness."""

MATRICES = [
    (1, 0, 0, 1),  # upright
    (-1, 0, 0, 1),  # mirrored left to right, as front cameras do
    (1, 0, 0, -1),  # mirrored top to bottom
    (-1, 0, 0, -1),  # turned by 180 degrees
    (0, 1, -1, 0),  # a quarter clockwise, as phones do
    (0, -1, 1, 0),  # a quarter counter-clockwise
    (0, 1, 1, 0),  # transposed
    (0, -1, -1, 0),  # transversed
]


def shown(image, a, b, c, d):
    """The image with every pixel put where a display matrix says."""
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width]
    to_x, to_y = a * x + c * y, b * x + d * y
    to_x, to_y = to_x - to_x.min(), to_y - to_y.min()
    out = np.empty((to_y.max() + 1, to_x.max() + 1, 3), np.uint8)
    out[to_y, to_x] = image
    return out


def set_matrix(path, a, b, c, d):
    """Write a display matrix into the track header of an MP4."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 44
    one = 1 << 16
    struct.pack_into(">9i", data, at, a * one, b * one, 0, c * one, d * one, 0, 0, 0, 1 << 30)
    path.write_bytes(data)


@pytest.mark.parametrize("matrix", MATRICES)
def test_the_whole_display_matrix_is_applied(encode, matrix):
    path = encode("turned.mp4", [CORNERS] * 3)
    set_matrix(path, *matrix)
    expected = shown(CORNERS, *matrix)
    with open_source(path) as source:
        assert source.size == expected.shape[1::-1]
        for frame in source:
            np.testing.assert_allclose(frame.image[8::16, 8::16], expected[8::16, 8::16], atol=6)


@pytest.mark.parametrize(
    ("orientation", "matrix"),
    [
        ("flip=horizontal", (-1, 0, 0, 1)),
        ("flip=vertical", (1, 0, 0, -1)),
        ("rotate=180", (-1, 0, 0, -1)),
        ("rotate=-90", (0, 1, -1, 0)),
    ],
)
def test_the_orientation_in_the_stream_is_applied(encode, tmp_path, orientation, matrix):
    plain = encode("plain.h264", [CORNERS] * 3)
    path = tmp_path / "sei.h264"
    with av.open(str(plain)) as source, path.open("wb") as target:
        stream = source.streams.video[0]
        orient = BitStreamFilterContext(
            f"h264_metadata=display_orientation=insert:{orientation}", stream
        )
        for packet in source.demux(stream):
            for changed in orient.filter(packet if packet.size else None):
                target.write(bytes(changed))
    expected = shown(CORNERS, *matrix)
    with open_source(path) as source:
        frame = next(iter(source))
    np.testing.assert_allclose(frame.image[8::16, 8::16], expected[8::16, 8::16], atol=6)


def packets(path):
    """Where the packets of a video lie in the file: position and bytes."""
    with av.open(str(path)) as container:
        return [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]


def break_packets(path, *numbers):
    data = bytearray(path.read_bytes())
    for position, size in (packets(path)[number] for number in numbers):
        data[position + 4 : position + size] = bytes(size - 4)
    path.write_bytes(data)


@pytest.mark.parametrize("broken", [(1,), (7,), (39,), (3, 4, 20)])
def test_packets_that_cannot_be_decoded_are_skipped_and_counted(noise, broken):
    with open_source(noise) as source:
        times = [frame.timestamp for frame in source]
    break_packets(noise, *broken)
    with open_source(noise) as source:
        frames = list(source)
        assert source.skipped == len(broken)
        assert source.missing_frames(frames[-1]) == 0
    assert [frame.index for frame in frames] == list(range(40 - len(broken)))
    assert {round(frame.timestamp, 4) for frame in frames} <= {round(time, 4) for time in times}
    with FirstFrameKept(open_source(noise, start_frame=30)) as source:
        assert source.first.index == 30
        assert np.array_equal(source.first.image, frames[30].image)
        assert [frame.index for frame in source] == list(range(30, 40 - len(broken)))
        assert source.skipped == len(broken)


@pytest.mark.parametrize(
    ("name", "codec"),
    [("c.avi", "ffv1"), ("c.mkv", "libx264"), ("c.mkv", "libsvtav1"), ("c.mp4", "libx264")],
)
def test_skipped_packets_are_counted_in_every_codec(encode, name, codec):
    if codec not in av.codecs_available:
        pytest.skip(f"this FFmpeg does not encode {codec}")
    random = np.random.default_rng(1)
    path = encode(
        name, [random.integers(0, 255, (144, 192, 3), np.uint8) for _ in range(12)], codec
    )
    data = bytearray(path.read_bytes())
    position, size = packets(path)[5]
    data[position + 60 : position + size - 2] = random.bytes(size - 62)
    path.write_bytes(data)
    with open_source(path) as source:
        assert (len(list(source)), source.skipped) == (11, 1)


def test_a_broken_packet_is_an_error_where_frames_have_annotations(noise):
    break_packets(noise, 7)
    given = []
    with (
        open_source(noise, skip_broken=False) as source,
        pytest.raises(SourceError, match="is broken after frame") as error,
    ):
        given += [frame.index for frame in source]
    with open_source(noise, skip_broken=False) as source, pytest.raises(SourceError):
        for frame in source:
            given.append(frame.index)
    assert given == list(range(len(given)))
    assert f"after frame {given[-1]}: " in str(error.value)
    assert f"; {len(given)} frames could be read" in str(error.value)


def test_frames_with_concealed_damage_are_marked(noise):
    data = bytearray(noise.read_bytes())
    for number in (5, 20):
        position, size = packets(noise)[number]
        middle = position + size // 2
        data[middle : position + size] = bytes(position + size - middle)
    noise.write_bytes(data)
    for _ in range(3):
        with open_source(noise) as source:
            assert [frame.index for frame in source if frame.damaged] == [5, 20]
            assert source.skipped == 0


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("c.mkv", "libx264"),
        ("c.webm", "libvpx"),
        ("c.mp4", "libx264"),
        ("c.avi", "mpeg4"),
        ("c.flv", "libx264"),
    ],
)
def test_a_file_has_a_length_and_a_cut_one_is_known(encode, name, codec):
    random = np.random.default_rng(1)
    images = [random.integers(0, 255, (48, 64, 3), np.uint8) for _ in range(40)]
    options = {"movflags": "+faststart"} if name.endswith("mp4") else {}
    path = encode(name, images, codec, options=options)
    with open_source(path) as source:
        assert abs(source.frame_count - 40) <= 2
        frames = list(source)
        assert (len(frames), source.missing_frames(frames[-1])) == (40, 0)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    with open_source(path) as source:
        frames = list(source)
        assert source.length_is_certain
        missing = source.missing_frames(frames[-1])
    assert 10 < len(frames) < 30
    assert abs(len(frames) + source.skipped + missing - 40) <= 3


def test_a_joined_stream_has_a_time_that_goes_on(encode, tmp_path):
    images = [np.full((48, 64, 3), 10 * i, np.uint8) for i in range(12)]
    one = encode("one.ts", images)
    joined = tmp_path / "joined.ts"
    joined.write_bytes(one.read_bytes() * 3)
    with open_source(joined) as source:
        times = [frame.timestamp for frame in source]
    np.testing.assert_allclose(times, np.arange(36) / 25, atol=1e-3)


@pytest.mark.parametrize(
    ("clock", "may_jump", "expected"),
    [
        ([5.0, 5.1, 5.2], False, [0.0, 0.1, 0.2]),
        ([5.0, 5.1, 0.0, 0.1], False, [0.0, 0.1, 0.2, 0.3]),  # begins again
        ([0.0, 0.1, 500.0, 500.1], True, [0.0, 0.1, 0.2, 0.3]),  # another recording
        ([0.0, 0.1, 500.0, 500.1], False, [0.0, 0.1, 500.0, 500.1]),  # a camera that waits
        ([0.0, 0.1, 0.05, 0.2], False, [0.0, 0.1, 0.1, 0.2]),  # a wrong timestamp
        ([None, None, None], False, [0.0, 0.1, 0.2]),  # no clock
        ([0.0, None, 0.2], False, [0.0, 0.1, 0.2]),
    ],
)
def test_timestamps_never_go_back(clock, may_jump, expected):
    timeline = Timeline(Fraction(10), may_jump)
    times = [timeline.seconds(time) for time in clock]
    np.testing.assert_allclose(times, expected, atol=1e-9)
    assert all(later >= earlier for earlier, later in pairwise(times))


@pytest.mark.parametrize(("matrix", "aspect"), [(MATRICES[0], 2), (MATRICES[4], Fraction(1, 2))])
def test_pixels_that_are_not_square_are_said(encode, matrix, aspect):
    path = encode("wide.mp4", [CORNERS] * 3, aspect=Fraction(2))
    set_matrix(path, *matrix)
    with open_source(path) as source:
        assert source.pixel_aspect == aspect
        (note,) = source.notes
    width, height = source.size
    assert f"boxes are in its stored {width} x {height} pixels" in note


def test_grey_video_of_16_bits_keeps_its_contrast(tmp_path):
    path = tmp_path / "thermal.mkv"
    grey = np.linspace(0, 255, 48 * 64).reshape(48, 64).round()
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "gray16le"
        for shift in (0, 40):
            pixels = (7000 + 4 * grey + shift).astype(np.uint16)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="gray16le")))
        container.mux(stream.encode())
    with open_source(path) as source:
        assert "scaled to 8 bits from 7000..8020" in source.notes[0]
        first, second = source
    np.testing.assert_allclose(first.image[..., 1], grey, atol=1)
    np.testing.assert_allclose(second.image[..., 1], np.minimum(grey + 10, 255), atol=1)


def test_a_title_that_is_not_utf_8_does_no_harm(encode):
    path = encode("titled.mkv", [CORNERS] * 2)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"ENCODER", b"ENC\xf6DER"))
    assert path.read_bytes() != data
    with open_source(path) as source:
        assert len(list(source)) == 2


def test_a_codec_that_is_not_known_is_said(encode):
    path = encode("unknown.mkv", [CORNERS] * 2)
    path.write_bytes(path.read_bytes().replace(b"V_MPEG4/ISO/AVC", b"V_MPEG9/ISO/AVC"))
    with pytest.raises(SourceError, match=r"cannot decode; convert it to H\.264"):
        open_source(path)
