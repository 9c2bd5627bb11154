"""Video out: H.264 in MP4, written whole or not at all, or as the frames come."""

from __future__ import annotations

import errno
import math
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import cv2
import numpy as np
from av.error import FFmpegError
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from re3.cores import spare_cores
from re3.video.partial import PartialFile

BT709 = 1
"""Number of that colour space, primaries, transfer curve in the H.264 standard (table E-3)."""

LIMITED_RANGE = 1
"""FFmpeg's number of luma 16 to 235."""

LONGEST_SIDE = 16384
"""Pixels that x264 takes at most."""

TICKS_PER_SECOND = 10_000
"""Timestamps are kept at least this finely."""

CLOCK_ERROR = 0.001
"""Seconds that a timestamp may be off the frame rate and still be meant to keep it: Matroska rounds
to milliseconds."""


class VideoWriter:
    """Writes frames as H.264 yuv420p in MP4, which plays in a browser.

    A context manager. The file appears under its name when the block ends, also when it ends by
    an exception or Ctrl-C: the frames written so far are finished properly. Without any frame no
    file appears, and an older one stays.

    Args:
        path: of the .mp4 file; its folder is made if needed.
        fps: frames a second; a Fraction is kept exactly.
        size: width and height in pixels, up to 16,384. yuv420p has even sides only: an odd one gets
            one more line at the right or bottom, a copy of the last.
        pixel_aspect: width of a pixel divided by its height; players stretch the video by it.
        live: write under the name from the first frame on, as fragmented MP4: where the process is
            killed, the file plays, but for a dozen frames that the encoder still had. An older
            file is lost with the first frame. When the block ends, it becomes an ordinary MP4,
            if there is room for a copy.

    Raises:
        ValueError: another ending than .mp4, or an unusable frame rate, size or pixel aspect.
        OSError: while it is used: the file cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        fps: float | Fraction,
        size: tuple[int, int],
        *,
        pixel_aspect: Fraction = Fraction(1),
        live: bool = False,
    ) -> None:
        self.path = Path(path)
        self.frames_written = 0
        if self.path.suffix.lower() != ".mp4":
            raise ValueError(f"video {self.path} does not end in .mp4, the one format written")
        if self.path.is_dir():
            raise ValueError(f"video {self.path} is a folder; expected the path of a file")
        if not fps > 0 or min(size) <= 0 or not pixel_aspect > 0:
            raise ValueError(
                f"frame rate {fps}, size {size} and pixel aspect {pixel_aspect} are unusable; "
                "expected above 0"
            )
        if max(size) > LONGEST_SIDE:
            raise ValueError(
                f"video {self.path} would have {size[0]} x {size[1]} pixels; H.264 is written up "
                f"to {LONGEST_SIDE} a side: leave the video out, or shrink the frames"
            )
        self.size = size
        self._pixel_aspect = pixel_aspect
        self._live = live
        self._rate = Fraction(fps).limit_denominator(100_000)
        # A whole number of ticks for each frame, and for each second.
        self._scale = math.ceil(TICKS_PER_SECOND / self._rate.numerator)
        self._time_base = Fraction(1, self._rate.numerator * self._scale)
        self._first_timestamp: float | None = None
        self._pts = 0
        self._partial: PartialFile | None = None
        self._within = False
        self._reformatter = VideoReformatter()

    def __enter__(self) -> Self:
        self._within = True
        return self

    def write(self, image: NDArray[np.uint8], timestamp: float | None = None) -> None:
        """Append a frame.

        Args:
            image: uint8 `[H, W, 3]` BGR. Of another size than the writer's it is scaled to fit,
                with black bars where its shape differs.
            timestamp: in seconds, for footage of variable frame rate; the first frame is shown at
                once, whatever its timestamp. None: one frame interval after the frame before.

        Raises:
            ValueError: another array than that.
            RuntimeError: outside the writer's `with` block.
            OSError: the file cannot be written.
        """
        if not self._within:
            raise RuntimeError("write() outside the writer's `with` block")
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
            raise ValueError(
                f"frame is {image.dtype} {list(image.shape)}; expected uint8 [H, W, 3], BGR"
            )
        odd_width, odd_height = self.size[0] % 2, self.size[1] % 2
        pixels = _fit(image, self.size)
        if odd_width or odd_height:
            pixels = np.pad(pixels, ((0, odd_height), (0, odd_width), (0, 0)), mode="edge")
        # The frame lies on the pixels: to copy 1080p took as long as to turn it into yuv420p.
        frame = av.VideoFrame.from_numpy_buffer(np.ascontiguousarray(pixels), format="bgr24")
        try:
            # Opened no earlier, so that nothing is left behind where tracking never starts.
            if self._partial is None:
                self._partial = self._open()
            # Without a named colour space players guess by the size of the frame, some wrongly.
            frame = self._reformatter.reformat(
                frame, format="yuv420p", dst_colorspace=BT709, dst_color_range=LIMITED_RANGE
            )
            self._pts = self._next_pts(timestamp)
            frame.pts, frame.time_base = self._pts, self._time_base
            for packet in self._stream.encode(frame):
                self._container.mux(packet)
        except FFmpegError as error:
            raise self._failure(error) from error
        self.frames_written += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._within = False
        if self._partial is None:
            return
        partial, self._partial = self._partial, None
        try:
            if self.frames_written:
                for packet in self._stream.encode():
                    self._container.mux(packet)
            self._container.close()
            if self.frames_written:
                self._complete(partial)
        except FFmpegError as failure:
            raise self._failure(failure) from failure
        finally:
            if not self._live or not self.frames_written:
                partial.discard()

    def _complete(self, partial: PartialFile) -> None:
        """Let the file appear; of a live one put the ordinary form in its place."""
        if not self._live:
            partial.commit()
            return
        whole = PartialFile(self.path)
        try:
            _rewrite(partial.path, whole.path)
            whole.commit()
        except OSError as error:
            # All frames are there already, in the fragmented form.
            if error.errno != errno.ENOSPC:
                raise
        finally:
            whole.discard()

    def _next_pts(self, timestamp: float | None) -> int:
        """The time of the next frame, in ticks; later than that of the frame before."""
        interval = self._rate.denominator * self._scale
        if self.frames_written == 0:
            self._first_timestamp = timestamp
            return 0
        if timestamp is None or self._first_timestamp is None:
            return self._pts + interval
        seconds = timestamp - self._first_timestamp
        tolerance = CLOCK_ERROR / self._time_base
        pts = round(seconds / self._time_base)
        on_rate = interval * round(pts / interval)
        if abs(on_rate - pts) <= tolerance:
            pts = on_rate
        return max(pts, self._pts + math.ceil(tolerance))

    def _open(self) -> PartialFile:
        partial = PartialFile(self.path, under_its_name=self._live)
        options = {"movflags": "+faststart"}
        if self._live:
            options = {
                "movflags": "+frag_every_frame+delay_moov+default_base_moof",
                "flush_packets": "1",
            }
        self._container = av.open(str(partial.path), "w", format="mp4", options=options)
        self._stream = self._container.add_stream("libx264", rate=self._rate)
        self._stream.width = self.size[0] + self.size[0] % 2
        self._stream.height = self.size[1] + self.size[1] % 2
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"preset": "veryfast", "crf": "20"}
        context = self._stream.codec_context
        context.time_base = self._time_base
        context.sample_aspect_ratio = self._pixel_aspect.limit_denominator(1000)
        # One more for each core makes a video alone sooner, but not one that is tracked meanwhile.
        context.thread_count = spare_cores()
        context.colorspace = context.color_primaries = context.color_trc = BT709
        context.color_range = LIMITED_RANGE
        return partial

    def _failure(self, error: FFmpegError) -> OSError:
        return OSError(
            f"video {self.path} cannot be written: {error.strerror or error} "
            f"(after {self.frames_written} frames)"
        )


def _rewrite(fragmented: Path, whole: Path) -> None:
    """Copy the packets of a video into an MP4 with its index in front."""
    options = {"movflags": "+faststart"}
    with (
        av.open(str(fragmented)) as source,
        av.open(str(whole), "w", format="mp4", options=options) as target,
    ):
        stream = source.streams.video[0]
        copied = target.add_stream_from_template(stream)
        for packet in source.demux(stream):
            if packet.dts is not None:  # the last, empty one has none
                packet.stream = copied
                target.mux(packet)


def _fit(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """The image scaled into a frame of that width and height, black around it."""
    width, height = size
    h, w = image.shape[:2]
    if (w, h) == size:
        return image
    scale = min(width / w, height / h)
    inner = (max(1, round(w * scale)), max(1, round(h * scale)))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
    canvas = np.zeros((height, width, 3), np.uint8)
    canvas[top : top + inner[1], left : left + inner[0]] = cv2.resize(
        image, inner, interpolation=method
    )
    return canvas
