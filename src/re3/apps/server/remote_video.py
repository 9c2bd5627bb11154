"""A video whose decoder runs in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path

import numpy as np

from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.wire import Head, read_message, write_message
from re3.video import Frame, SourceError

ANSWER_SECONDS = 120.0
"""A decoder that is silent for so long is killed."""

HOP = 250
"""Frames that are asked for at once, at most, on the way to a later one."""

ENVIRONMENT = {"OPENCV_IO_MAX_IMAGE_PIXELS": str(1 << 26), "OMP_NUM_THREADS": "1"}
"""Of processes that decode; OpenCV refuses pictures of more pixels by their header."""


class DecoderError(SourceError):
    """The decoder process crashed, or hung and was killed."""


class RemoteVideo:
    """Frames of an uploaded file or of a folder of pictures, by index.

    Calls come from one thread at a time.

    Args:
        limits: of the server.
        answer_seconds: that the decoder may take for one answer.

    Attributes:
        fps: frames a second.
        size: width and height in pixels of the first frame.
        frame_count: as far as it is known, or None.
    """

    def __init__(self, limits: Limits, answer_seconds: float = ANSWER_SECONDS) -> None:
        self.fps = Fraction(30)
        self.size = (0, 0)
        self.frame_count: int | None = None
        self._limits = limits
        self._answer_seconds = answer_seconds
        self._killed = self._closed = False
        self._furthest = 0
        self._opening: Head | None = None
        self._unreadable: tuple[int, str] | None = None  # from which frame on, and why
        self._process = self._start()

    @property
    def process_id(self) -> int:
        """Of the decoder."""
        return self._process.pid

    def open(self, path: Path, pictures: bool = False) -> None:
        """Begin with a file, or with a folder of at least one picture, which may grow.

        Raises:
            SourceError: not a video, or without a frame.
            OverLimitError: too large or too long.
        """
        opening = {"do": "open", "path": str(path), "pictures": pictures}
        said, _ = self._ask(opening)
        self._opening = opening
        self.fps = Fraction(*said["fps"])
        self.size = (said["width"], said["height"])
        self.frame_count = None if pictures else said["count"]

    def read(self, index: int) -> Frame | None:
        """The frame, or None where the video ends before it.

        Raises:
            SourceError: the video is broken before that frame.
            OverLimitError: the video is too long, or the frame too large.
        """
        if self._unreadable is not None and index >= self._unreadable[0]:
            raise DecoderError(self._unreadable[1])
        # In hops, as each answer has to come in time.
        for hop in range(self._furthest + HOP, index, HOP):
            if "end" in self._ask_for_frame(hop)[0]:
                break
            self._furthest = hop
        said, pixels = self._ask_for_frame(index)
        if "end" in said:
            self.frame_count = said["end"]
            return None
        self._furthest = max(self._furthest, index)
        image = np.frombuffer(pixels, np.uint8).reshape(said["shape"])
        return Frame(image, said["index"], said["timestamp"])

    def close(self) -> None:
        """End the decoder; a call in another thread ends in a DecoderError."""
        self._closed = True
        self._end_process()

    def _end_process(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what could not be written any more
                    pipe.close()

    def _start(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "re3.apps.server.decoder", json.dumps(asdict(self._limits))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **ENVIRONMENT},
        )

    def _ask_for_frame(self, index: int) -> tuple[Head, bytearray]:
        command = {"do": "read", "index": index}
        with suppress(DecoderError):
            if self._process.poll() is None:
                return self._ask(command)
        try:
            # It may have died of the frame it was reading ahead.
            self._restart()
            return self._ask(command)
        except DecoderError as error:
            self._unreadable = (index, str(error))
            raise

    def _restart(self) -> None:
        """After a crash: the frames before it can be read once more."""
        if self._closed:
            raise DecoderError("the video has been closed")
        self._end_process()
        self._killed = False
        self._process = self._start()
        if self._opening is not None:
            self._ask(self._opening)

    def _ask(self, command: Head) -> tuple[Head, bytearray]:
        assert self._process.stdin is not None and self._process.stdout is not None
        watch = threading.Timer(self._answer_seconds, self._give_up)
        watch.daemon = True
        watch.start()
        try:
            write_message(self._process.stdin, command)
            said, pixels = read_message(self._process.stdout)
        except (OSError, EOFError, ValueError) as error:
            self._end_process()
            raise DecoderError(self._why_dead()) from error
        finally:
            watch.cancel()
        if "error" in said:
            if said["limit"] is not None:
                raise OverLimitError(said["limit"], said["error"])
            raise SourceError(said["error"])
        return said, pixels

    def _give_up(self) -> None:
        self._killed = True
        self._process.kill()

    def _why_dead(self) -> str:
        if self._killed:
            return (
                f"the video's decoder gave no answer for {self._answer_seconds:g} seconds and was "
                "stopped; is the file damaged? Convert it to H.264 in MP4 and try again"
            )
        return (
            "the video's decoder crashed; the file is damaged or too large for this machine's "
            "memory. Convert it to H.264 in MP4 and try again"
        )
