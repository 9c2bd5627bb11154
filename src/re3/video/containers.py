"""Frames from video files and network streams, decoded by FFmpeg."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from fractions import Fraction
from itertools import chain
from pathlib import Path

import av
import numpy as np
from av.error import FFmpegError, InvalidDataError, ProtocolNotFoundError
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from re3.video.addresses import is_stream, scheme_of, without_password
from re3.video.announced import Announced
from re3.video.base import Frame, SourceError, VideoSource
from re3.video.grey_levels import DEEP_FORMATS, GreyLevels, Range
from re3.video.orientation import UPRIGHT, Orientation
from re3.video.timeline import Timeline

STREAM_TIMEOUT = 10.0
"""Seconds that a stream may take to open or to send a packet."""

DECODER_THREADS = 2
"""Enough to decode ahead of the tracker; FFmpeg's default is one for each core, which it needs."""

FULL_RANGE = 2
"""FFmpeg's number of pixel values 0 to 255."""

CLOCK_JUMPS = 0x0200
"""FFmpeg's flag of formats whose clock may jump, AVFMT_TS_DISCONT."""

FALLBACK_RATE = Fraction(30)
"""Frames a second of a container that does not say."""


class ContainerSource(VideoSource):
    """A video file or a network stream.

    Frames are counted as they are decoded, so that indices are exact in every format. Packets that
    cannot be decoded are skipped and counted; frames with concealed damage are marked. Frames come
    upright and not mirrored, as the display matrix of the recording says.

    Args:
        location: a file's path or a stream's address.
        start_frame: frames before this one are decoded and dropped.
        skip_broken: False raises at a packet of a file that cannot be decoded.
        value_range: of 16-bit grey video, as in `re3.video.open_source`.

    Raises:
        SourceError: it cannot be opened, holds no video, or ends before `start_frame`.
    """

    def __init__(
        self,
        location: str,
        start_frame: int = 0,
        *,
        skip_broken: bool = True,
        value_range: Range | None = None,
    ) -> None:
        self._live = is_stream(location)
        self._shown = without_password(location)
        self.name = self._shown if self._live else Path(location).name
        self._skip_broken = skip_broken
        self._skipped = 0
        self._container = self._open(location)
        self._decoded = 0
        self._reformatter = VideoReformatter()
        self._levels = GreyLevels(value_range)
        self._orientation = UPRIGHT
        self._decoder = self._decode(start_frame)
        try:
            if not self._container.streams.video:
                raise SourceError(
                    f"{self._shown} has no video in it; expected at least one video track"
                )
            self._stream = self._container.streams.video[0]
            if self._stream.codec_context is None:
                raise SourceError(
                    f"{self._shown} has video of a kind that this FFmpeg cannot decode; convert it "
                    "to H.264"
                )
            # Not frame threads: next to a broken packet they lose frames, and mark sound ones as
            # damaged.
            self._stream.thread_type = "SLICE"
            self._stream.codec_context.thread_count = DECODER_THREADS
            self.fps = Fraction(
                self._stream.average_rate or self._stream.guessed_rate or FALLBACK_RATE
            )
            jumps = bool(self._container.format.flags & CLOCK_JUMPS)
            self._timeline = Timeline(self.fps, may_jump=jumps)
            self._announced = Announced.by(self._container, self._stream, self.fps)
            self.frame_count = self._announced.frames
            first = next(self._decoder, None)
            if first is None:
                raise SourceError(self._why_no_frame(start_frame))
        except SourceError:
            self.close()
            raise
        height, width = first.image.shape[:2]
        self.size = (width, height)
        self.pixel_aspect = self._shown_pixel_aspect()
        self.notes = self._found_notes()
        self._frames: Iterator[Frame] = chain((first,), self._decoder)

    def __iter__(self) -> Iterator[Frame]:
        yield from self._frames

    def close(self) -> None:
        # Ended first: a decoder that goes on reading a closed container would crash.
        self._decoder.close()
        self._frames = iter(())
        self._container.close()

    @property
    def skipped(self) -> int:
        """See `VideoSource`."""
        return self._skipped

    @property
    def length_is_certain(self) -> bool:
        """See `VideoSource`."""
        return self._announced.certain

    def missing_frames(self, last: Frame) -> int:
        """See `VideoSource`; differences too small to mean anything are 0."""
        return self._announced.missing(last.index + 1 + self._skipped, last.timestamp, self.fps)

    def _open(self, location: str) -> av.container.InputContainer:
        options = {"rtsp_transport": "tcp"} if location.lower().startswith("rtsp") else {}
        try:
            return av.open(
                self._address(location),
                options=options,
                metadata_errors="replace",  # titles in Latin-1 are common
                timeout=STREAM_TIMEOUT if self._live else None,
            )
        except (FFmpegError, OSError) as error:
            if isinstance(error, ProtocolNotFoundError):
                raise SourceError(
                    f"{self._shown} cannot be opened: this FFmpeg is built without "
                    f"{scheme_of(location)}; expected rtsp, http, tcp, udp or rtp, or a file"
                ) from error
            cut = isinstance(error, InvalidDataError)
            raise SourceError(
                f"{self._shown} cannot be opened as a video: {_reason(error)}; expected a file or "
                "stream that FFmpeg reads, such as MP4 with H.264"
                + (", recorded to its end: one cut off has no index" if cut else "")
            ) from error

    def _address(self, location: str) -> str:
        """What FFmpeg is given: `12:30.mp4` would be a protocol called 12, `HTTP` is none."""
        if not self._live:
            return f"file:{location}"
        scheme = scheme_of(location) or ""
        return scheme + location[len(scheme) :]

    def _shown_pixel_aspect(self) -> Fraction:
        stored = self._stream.sample_aspect_ratio
        if not stored or stored < 0:
            return Fraction(1)
        return Fraction(1 / stored if self._orientation.transposed else stored)

    def _found_notes(self) -> tuple[str, ...]:
        notes = [] if self._levels.note is None else [f"{self.name}: {self._levels.note}"]
        if self.pixel_aspect != 1:
            width, height = self.size
            notes.append(
                f"{self.name} has pixels {float(self.pixel_aspect):.4g} times as wide as high: "
                f"boxes are in its stored {width} x {height} pixels, not in those of the stretched "
                "picture"
            )
        return tuple(notes)

    def _why_no_frame(self, start_frame: int) -> str:
        if self._decoded == 0:
            return (
                f"{self._shown} is a video, but no frame of it can be decoded; does it play "
                "elsewhere? If so, convert it to H.264"
            )
        return (
            f"{self._shown} has no frame {start_frame}; it ends before, after {self._decoded} "
            f"frames; expected a start frame from 0 to {self._decoded - 1}"
        )

    def _why_broken(self, error: FFmpegError) -> str:
        if self._decoded:
            return (
                f"{self._shown} is broken after frame {self._decoded - 1}: {_reason(error)}; "
                f"{self._decoded} frames could be read"
            )
        if self._live:
            return (
                f"{self._shown} gives no frame: {_reason(error)}; a video file has to come from a "
                "server that answers range requests (Python's http.server does not): download it "
                "and give its path, or record it with its index in front (-movflags faststart)"
            )
        return f"{self._shown} is broken from its first frame on: {_reason(error)}"

    def _decode(self, start_frame: int) -> Generator[Frame, None, None]:
        try:
            for frame in self._decoded_frames():
                index = self._decoded
                self._decoded += 1
                timestamp = self._timestamp(index, frame)
                if index >= start_frame:
                    yield Frame(self._image(frame), index, timestamp, frame.is_corrupt)
        except FFmpegError as error:
            raise SourceError(self._why_broken(error)) from error

    def _timestamp(self, index: int, frame: av.VideoFrame) -> float:
        """Of the frame, the next of those decoded."""
        del index
        return self._timeline.seconds(frame.time)

    def _decoded_frames(self) -> Iterator[av.VideoFrame]:
        begun, unanswered = False, 0
        is_av1 = self._stream.codec.canonical_name == "av1"
        for packet in self._container.demux(self._stream):
            try:
                frames = packet.decode()
            except InvalidDataError:
                # A recording cut out of a broadcast begins with packets that refer to frames
                # before it: what cannot be decoded there is not a frame of the file.
                if not (self._live or self._skip_broken or self._decoded == 0):
                    raise
                self._skipped += begun
                continue
            begun = True
            unanswered += bool(packet.size and not packet.is_discard) - len(frames)
            yield from frames
        # Decoders of AV1 drop what they cannot decode without an error. A packet is a frame there.
        if is_av1:
            self._skipped += max(0, unanswered)

    def _image(self, frame: av.VideoFrame) -> NDArray[np.uint8]:
        self._orientation = Orientation.of_frame(frame)
        if frame.format.name in DEEP_FORMATS:
            grey = self._levels.scaled(frame.to_ndarray())
            return self._orientation.applied(np.repeat(grey[..., np.newaxis], 3, axis=2))
        # Said in full, as PyAV before 17 takes all video for BT.601: pure red came out as
        # (0, 0, 230).
        bgr = self._reformatter.reformat(
            frame,
            format="bgr24",
            src_colorspace=frame.colorspace,
            src_color_range=frame.color_range,
            dst_color_range=FULL_RANGE,
        )
        image: NDArray[np.uint8] = bgr.to_ndarray()  # type: ignore[assignment]
        return self._orientation.applied(image)


def _reason(error: Exception) -> str:
    if isinstance(error, av.error.ExitError):
        return f"nothing came for {STREAM_TIMEOUT:.0f} seconds"
    return getattr(error, "strerror", None) or str(error)
