"""The decoder process of a session: `python -m re3.apps.server.decoder`.

It reads commands from standard input and answers on standard output, in messages as in
`re3.apps.server.wire`. Files of strangers are decoded here and nowhere else: where one makes a
library crash, or eat memory, this process ends, and the server does not.

    {"do": "open", "path": ..., "pictures": false}  -> {"fps": [n, d], "width", "height", "count"}
    {"do": "read", "index": i}                      -> {"index", "timestamp", "shape"} and pixels
                                                       or {"end": count}

Any answer may be {"error": text, "limit": kind or null} instead.
"""

from __future__ import annotations

import json
import os
import sys
import zlib
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import IO

import av
import numpy as np

from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.wire import Head, read_message, write_message
from re3.video import Frame, SourceError, VideoSource
from re3.video.containers import ContainerSource
from re3.video.file_kinds import EXPECTED, PICTURE, kind_of_file
from re3.video.images import open_image, read_image, sorted_images
from re3.video.seeking import SeekableSource

MEMORY_LIMIT = 4 << 30
"""Bytes of address space the process may take, where the system can limit it."""

CACHE_BYTES = 192 << 20
"""Of frames kept, so that stepping back is quick."""

FRAMES_BEFORE = 16
"""Read as well when going back, as who steps back once does so again."""

PRINT_ROWS = 16
"""Of so many rows of a frame one goes into its print."""

Answer = tuple[Head, memoryview | bytes]


class Decoder:
    """Frames of one video by index, with those read last kept.

    Going back further than that goes by keyframes. An index means the same frame as in `re3 track`,
    whatever the file's own index says: frames that come a second time are compared with what they
    were, and where one differs the file is decoded from its beginning instead.

    Args:
        limits: of the server.
        cache_bytes: of frames kept.
    """

    def __init__(self, limits: Limits, cache_bytes: int = CACHE_BYTES) -> None:
        self._limits = limits
        self._cache_bytes = cache_bytes
        self._path = Path()
        self._images: list[Path] | None = None
        self._source: VideoSource | None = None
        self._frames: Iterator[Frame] = iter(())
        self._next = 0
        self._end: int | None = None
        self._broken: SourceError | None = None
        self._cache: OrderedDict[int, Frame] = OrderedDict()
        self._prints: list[int] = []
        self._by_keyframes = True

    def open(self, path: Path, pictures: bool = False) -> Head:
        """Begin with a video, or with a folder of pictures that may still grow.

        Raises:
            SourceError: not a video, or without a frame.
            OverLimitError: too large or too long.
        """
        self._path = path
        if pictures:
            self._images = sorted_images(path.iterdir())
            first = self._read_picture(0)
            if first is None:
                raise SourceError("the folder has no picture in it")
            height, width = first.image.shape[:2]
            return {"fps": [30, 1], "width": width, "height": height, "count": None}
        self._check_header(path)
        source = self._reopened(0)
        width, height = source.size
        self._limits.check_size(width, height)
        return {
            "fps": [source.fps.numerator, source.fps.denominator],
            "width": width,
            "height": height,
            "count": source.frame_count,
        }

    def read(self, index: int) -> Frame | None:
        """The frame, or None where the video ends before it.

        Raises:
            SourceError: the video is broken before that frame.
            OverLimitError: it is later than a video may be long, or larger than it may be.
        """
        if index in self._cache:
            return self._cache[index]
        if self._images is not None:
            return self._read_picture(index)
        if index < self._next:
            self._go_back(max(0, index - FRAMES_BEFORE))
        if self._broken is not None:
            raise self._broken
        while self._end is None or index < self._end:
            frame = self._next_frame()
            if frame is None:
                self._end = self._next
                break
            if not self._is_the_same(frame):
                self._by_keyframes = False
                self._go_back(max(0, frame.index - FRAMES_BEFORE))
                continue
            self._next = frame.index + 1
            if self._kept(frame).index == index:
                return frame
        return None

    @property
    def pixel_aspect(self) -> Fraction:
        """Width of a pixel divided by its height, as the video is to be shown."""
        return Fraction(1) if self._source is None else self._source.pixel_aspect

    @property
    def end(self) -> int | None:
        """How many frames there are, once it is known."""
        return self._end

    def read_ahead(self) -> None:
        """Decode the next frame while the server is busy with this one."""
        with suppress(SourceError, OverLimitError):  # raised again when it is asked for
            if self._images is None and self._end is None:
                self.read(self._next)

    def without_path(self, message: str) -> str:
        """A message that does not tell where the file lies on the server."""
        return message.replace(str(self._path), "the video")

    def _next_frame(self) -> Frame | None:
        try:
            return next(self._frames, None)
        except SourceError as error:
            # Reading ahead may have met it; who asks for the frame is to be told.
            self._broken = error
            raise

    def _read_picture(self, index: int) -> Frame | None:
        assert self._images is not None
        if index >= len(self._images):  # more may have come since
            self._images = sorted_images(self._path.iterdir())
        if index >= len(self._images):
            self._end = len(self._images)
            return None
        path = self._images[index]
        if kind_of_file(path) != PICTURE:
            raise SourceError("a frame of a camera has to be a JPEG, PNG or WebP picture")
        return self._kept(Frame(read_image(path), index, index / 30))

    def _check_header(self, path: Path) -> None:
        """Refuse by what the header says, before a single frame is decoded."""
        if kind_of_file(path) is None:
            raise SourceError(f"the file is not one that can be tracked in; expected {EXPECTED}")
        with (
            suppress(av.error.FFmpegError),
            av.open(str(path), metadata_errors="replace") as container,
        ):
            if container.streams.video:
                stream = container.streams.video[0]
                if stream.codec_context is not None:
                    self._limits.check_size(stream.codec_context.width, stream.codec_context.height)
            if container.duration is not None:
                self._limits.check_duration(container.duration / av.time_base)

    def _go_back(self, index: int) -> None:
        source = self._source
        if self._by_keyframes and isinstance(source, SeekableSource):
            try:
                if source.go_back(index):
                    self._frames, self._next, self._broken = iter(source), index, None
                    return
            except SourceError:
                pass  # as good as not being able to
        self._by_keyframes = False
        self._reopened(index)

    def _is_the_same(self, frame: Frame) -> bool:
        """Whether the frame is as it was the first time; true of one that is new."""
        rows = np.ascontiguousarray(frame.image[::PRINT_ROWS])
        found = zlib.crc32(rows.data.cast("B"))
        if frame.index == len(self._prints):
            self._prints.append(found)
        return not self._by_keyframes or self._prints[frame.index] == found

    def _reopened(self, start: int) -> VideoSource:
        if self._source is not None:
            self._source.close()
        source: VideoSource
        if kind_of_file(self._path) == PICTURE:
            source = open_image(self._path, start)
        else:
            path = str(self._path)
            source = SeekableSource(path) if self._by_keyframes else ContainerSource(path, start)
        self._source, self._frames, self._next = source, iter(source), start
        self._broken = None
        return source

    def _kept(self, frame: Frame) -> Frame:
        self._limits.check_duration(frame.timestamp)
        self._limits.check_size(frame.image.shape[1], frame.image.shape[0])
        self._cache[frame.index] = frame
        # The newest few stay however large they are: the one asked for and the one read ahead.
        while len(self._cache) > 3 and self._cached_bytes() > self._cache_bytes:
            self._cache.popitem(last=False)
        return frame

    def _cached_bytes(self) -> int:
        return len(self._cache) * next(reversed(self._cache.values())).image.nbytes


def answer(decoder: Decoder, command: Head) -> Answer:
    """What a command gives, an error included."""
    try:
        if command["do"] == "open":
            return decoder.open(Path(command["path"]), command["pictures"]), b""
        frame = decoder.read(command["index"])
    except OverLimitError as error:
        return {"error": str(error), "limit": error.kind}, b""
    except (SourceError, OSError, MemoryError) as error:
        told = decoder.without_path(str(error) or "it does not fit into memory")
        return {"error": told, "limit": None}, b""
    if frame is None:
        return {"end": decoder.end}, b""
    pixels = np.ascontiguousarray(frame.image)
    head = {"index": frame.index, "timestamp": frame.timestamp, "shape": pixels.shape}
    return head, pixels.data.cast("B")


def serve(commands: IO[bytes], answers: IO[bytes], limits: Limits) -> None:
    """Answer commands until there are no more."""
    decoder = Decoder(limits)
    while True:
        try:
            command, _ = read_message(commands)
        except EOFError:
            return
        write_message(answers, *answer(decoder, command))
        if command["do"] == "read":
            decoder.read_ahead()


def limit_memory() -> None:
    """Let the process have no more than `MEMORY_LIMIT`, and leave no core file."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main() -> None:
    """Entry point; the server gives its limits as the only argument."""
    limit_memory()
    # Whatever a library prints must not get between the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with suppress(BrokenPipeError):
        serve(sys.stdin.buffer, answers, Limits(**json.loads(sys.argv[1])))


if __name__ == "__main__":
    main()
