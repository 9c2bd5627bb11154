"""Video out: H.264 in MP4, written whole or not at all."""

from __future__ import annotations

import os
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import cv2
import numpy as np
from numpy.typing import NDArray


class VideoWriter:
    """Writes frames as H.264 yuv420p in MP4, which plays in a browser.

    A context manager. The file appears under its name when the block ends, also when it ends by
    an exception or Ctrl-C: the frames written so far are finished properly. Without any frame no
    file appears.

    Args:
        path: of the .mp4 file; its folder is made if needed.
        fps: frames a second; a Fraction is kept exactly.
        size: width and height in pixels. yuv420p has even sides only: an odd one gets one more
            line, a copy of the last.

    Raises:
        ValueError: another ending than .mp4, or an unusable frame rate or size.
    """

    def __init__(self, path: str | Path, fps: float | Fraction, size: tuple[int, int]) -> None:
        self.path = Path(path)
        self.frames_written = 0
        if self.path.suffix.lower() != ".mp4":
            raise ValueError(f"video {self.path} does not end in .mp4, the one format written")
        if fps <= 0 or min(size) <= 0:
            raise ValueError(f"frame rate {fps} and size {size} are unusable; expected above 0")
        self.size = size
        self._rate = Fraction(fps).limit_denominator(100_000)
        self._partial = self.path.with_name(f".{self.path.name}.{os.getpid()}.partial")
        self._container: av.container.OutputContainer | None = None

    def __enter__(self) -> Self:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._container = av.open(
            str(self._partial), "w", format="mp4", options={"movflags": "+faststart"}
        )
        self._stream = self._container.add_stream("libx264", rate=self._rate)
        self._stream.width = self.size[0] + self.size[0] % 2
        self._stream.height = self.size[1] + self.size[1] % 2
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"preset": "veryfast", "crf": "20"}
        return self

    def write(self, image: NDArray[np.uint8]) -> None:
        """Append a frame, uint8 `[H, W, 3]` BGR; of another size it is scaled to the writer's."""
        if self._container is None:
            raise RuntimeError("write() outside the writer's `with` block")
        if (image.shape[1], image.shape[0]) != self.size:
            image = cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)
        odd_width, odd_height = self.size[0] % 2, self.size[1] % 2
        if odd_width or odd_height:
            image = np.pad(image, ((0, odd_height), (0, odd_width), (0, 0)), mode="edge")
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")
        frame.pts = self.frames_written
        frame.time_base = 1 / self._rate
        for packet in self._stream.encode(frame):
            self._container.mux(packet)
        self.frames_written += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._container is not None
        container, self._container = self._container, None
        try:
            if self.frames_written:
                for packet in self._stream.encode():
                    container.mux(packet)
            container.close()
            if self.frames_written:
                self._partial.replace(self.path)
        finally:
            self._partial.unlink(missing_ok=True)
