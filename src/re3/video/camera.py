"""Frames from a camera of this machine."""

from __future__ import annotations

import time
from collections.abc import Iterator
from fractions import Fraction
from itertools import chain

import cv2

from re3.video.base import Frame, SourceError, VideoSource

MOST_CAMERAS = 100
"""OpenCV takes an index from this on as the number of a backend as well."""


class CameraSource(VideoSource):
    """A camera, by its index; timestamps are those of a clock, as frames may be missed.

    Args:
        index: of the camera, 0 for the first.
        start_frame: so many frames are skipped, for a camera that has to settle, say.

    Raises:
        SourceError: no such camera, or it gives no frames. While frames are read: it stopped.
    """

    def __init__(self, index: int, start_frame: int = 0) -> None:
        if not 0 <= index < MOST_CAMERAS:
            raise SourceError(
                f"camera index is {index}; expected 0 for the first camera, up to "
                f"{MOST_CAMERAS - 1}; a file of that name is given by its path, such as ./{index}"
            )
        self.name = f"camera {index}"
        self.frame_count = None
        self._capture = _open_quietly(index)
        if not self._capture.isOpened():
            raise SourceError(
                f"camera {index} cannot be opened; is it plugged in, free, and are you allowed to "
                "use it (on Linux: a member of group video)? If a file was meant, give its path"
            )
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.fps = Fraction(rate if 0 < rate < 1000 else 30).limit_denominator(1001)
        frames = self._read(start_frame)
        try:
            # Read at once: a camera that opens may still give nothing, or another size than it
            # said.
            first = next(frames)
        except SourceError:
            self.close()
            raise
        height, width = first.image.shape[:2]
        self.size = (width, height)
        self._frames = chain((first,), frames)

    def __iter__(self) -> Iterator[Frame]:
        yield from self._frames

    def close(self) -> None:
        self._capture.release()

    def _read(self, start_frame: int) -> Iterator[Frame]:
        index, started = 0, 0.0
        while True:
            ok, image = self._capture.read()
            now = time.monotonic()
            if not ok:
                raise SourceError(
                    f"{self.name} gave {index} frames and then none; is it still plugged in, "
                    "and free?"
                )
            started = started or now
            if index >= start_frame:
                yield Frame(image, index, now - started)
            index += 1


def _open_quietly(index: int) -> cv2.VideoCapture:
    """OpenCV prints warnings of its own where there is no camera; the error says it better."""
    logging = getattr(cv2.utils, "logging", cv2)  # in OpenCV 5, in OpenCV 4
    level = logging.getLogLevel()
    logging.setLogLevel(0)
    try:
        return cv2.VideoCapture(index)
    finally:
        logging.setLogLevel(level)
