"""Frames from video files and network streams, decoded by FFmpeg."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator
from fractions import Fraction
from itertools import chain
from pathlib import Path

import av
import numpy as np
from av.error import FFmpegError, InvalidDataError
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from re3.video.base import Frame, SourceError, VideoSource

STREAM_PREFIXES = ("rtsp://", "rtsps://", "rtmp://", "http://", "https://", "udp://")
STREAM_TIMEOUT = 10.0
"""Seconds that a stream may take to open or to send a packet."""

DECODER_THREADS = 2
"""Enough to decode ahead of the tracker; FFmpeg's default is one for each core, which it needs."""

FULL_RANGE = 2
"""FFmpeg's number of pixel values 0 to 255."""

FALLBACK_RATE = Fraction(30)
"""Frames a second of a container that does not say."""


class ContainerSource(VideoSource):
    """A video file or a network stream.

    Frames are counted as they are decoded, so that indices are exact in every format. A file is
    read strictly: where it breaks, iterating raises. A stream goes on after packets that arrive
    damaged; its index counts the frames delivered. Recordings marked as turned come upright.

    Args:
        location: a file's path or a stream's address.
        start_frame: frames before this one are decoded and dropped.

    Raises:
        SourceError: it cannot be opened, holds no video, or ends before `start_frame`.
    """

    def __init__(self, location: str, start_frame: int = 0) -> None:
        self._live = location.startswith(STREAM_PREFIXES)
        self._shown = without_password(location)
        self.name = self._shown if self._live else Path(location).name
        self._container = self._open(location)
        self._decoded = 0
        self._reformatter = VideoReformatter()
        self._start_time: float | None = None
        self._decoder = self._decode(start_frame)
        try:
            if not self._container.streams.video:
                raise SourceError(
                    f"{self._shown} has no video in it; expected at least one video track"
                )
            self._stream = self._container.streams.video[0]
            self._stream.thread_type = "AUTO"
            self._stream.codec_context.thread_count = DECODER_THREADS
            self.fps = Fraction(
                self._stream.average_rate or self._stream.guessed_rate or FALLBACK_RATE
            )
            self.frame_count = self._stream.frames or self._estimated_count()
            first = next(self._decoder, None)
            if first is None:
                raise SourceError(self._why_no_frame(start_frame))
        except SourceError:
            self.close()
            raise
        height, width = first.image.shape[:2]
        self.size = (width, height)
        self._frames: Iterator[Frame] = chain((first,), self._decoder)

    def __iter__(self) -> Iterator[Frame]:
        yield from self._frames

    def close(self) -> None:
        # Ended first: a decoder that goes on reading a closed container would crash.
        self._decoder.close()
        self._frames = iter(())
        self._container.close()

    def _open(self, location: str) -> av.container.InputContainer:
        options = {"rtsp_transport": "tcp"} if location.startswith("rtsp") else {}
        try:
            return av.open(
                location, options=options, timeout=STREAM_TIMEOUT if self._live else None
            )
        except (FFmpegError, OSError) as error:
            cut = isinstance(error, InvalidDataError)
            raise SourceError(
                f"{self._shown} cannot be opened as a video: {_reason(error)}; expected a file or "
                "stream that FFmpeg reads, such as MP4 with H.264"
                + (", recorded to its end: one cut off has no index" if cut else "")
            ) from error

    def _estimated_count(self) -> int | None:
        if self._stream.duration is None or self._stream.time_base is None:
            return None
        return round(float(self._stream.duration * self._stream.time_base) * self.fps)

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
                time = frame.time if frame.time is not None else float(index / self.fps)
                if self._start_time is None:
                    self._start_time = time
                if index >= start_frame:
                    image = _upright_bgr(frame, self._reformatter)
                    yield Frame(image, index, time - self._start_time)
        except FFmpegError as error:
            raise SourceError(self._why_broken(error)) from error

    def _decoded_frames(self) -> Iterator[av.VideoFrame]:
        for packet in self._container.demux(self._stream):
            try:
                frames = packet.decode()
            except InvalidDataError:
                # A recording cut out of a broadcast begins with packets that refer to frames
                # before it: what cannot be decoded there is not a frame of the file.
                if self._live or self._decoded == 0:
                    continue
                raise
            yield from frames


def without_password(location: str) -> str:
    """An address as it may be shown: user and password of a stream left out."""
    return re.sub(r"(?<=://)[^/@]*@", "", location)


def _upright_bgr(frame: av.VideoFrame, reformatter: VideoReformatter) -> NDArray[np.uint8]:
    # Said in full, as PyAV before 17 takes all video for BT.601: pure red came out as (0, 0, 230).
    bgr = reformatter.reformat(
        frame,
        format="bgr24",
        src_colorspace=frame.colorspace,
        src_color_range=frame.color_range,
        dst_color_range=FULL_RANGE,
    )
    image: NDArray[np.uint8] = bgr.to_ndarray()  # type: ignore[assignment]
    if frame.rotation:  # phones record sideways and say so
        image = np.ascontiguousarray(np.rot90(image, round(frame.rotation / 90)))
    return image


def _reason(error: Exception) -> str:
    if isinstance(error, av.error.ExitError):
        return f"nothing came for {STREAM_TIMEOUT:.0f} seconds"
    return getattr(error, "strerror", None) or str(error)
