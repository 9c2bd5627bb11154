"""Where frames come from: a video file, a folder or glob of images, a camera, a stream."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import av
import cv2
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"})
STREAM_PREFIXES = ("rtsp://", "rtsps://", "rtmp://", "http://", "https://", "udp://")
IMAGES_FPS = Fraction(30)
"""Frame rate of a folder of images, which carries none."""

STREAM_TIMEOUT = 10.0
"""Seconds that a stream may take to open or to send a packet."""


class SourceError(ValueError):
    """A source cannot be opened or read; the message says what was found and what to do."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame.

    Attributes:
        image: uint8 `[H, W, 3]` BGR.
        index: 0-based in the source, so that with `start_frame=30` the first is 30.
        timestamp: seconds from the source's first frame.
    """

    image: NDArray[np.uint8]
    index: int
    timestamp: float


class VideoSource(Protocol):
    """An iterable of frames that can be walked once, and a context manager that closes it.

    Attributes:
        name: short, for people.
        fps: frames a second.
        size: width and height of the first frame in pixels.
        frame_count: of the whole source, where it is known (of a video file it may be an
            estimate), else None.
    """

    name: str
    fps: Fraction
    size: tuple[int, int]
    frame_count: int | None

    def __iter__(self) -> Iterator[Frame]: ...

    def close(self) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def open_source(spec: str | int | Path, *, start_frame: int = 0) -> VideoSource:
    """Open a source of frames.

    Args:
        spec: a video file; a folder of images or a glob such as `shots/*.png` (natural order:
            `img2` before `img10`); a camera's index (0, or "0"); an RTSP or HTTP stream.
        start_frame: frames before this one are skipped.

    Raises:
        SourceError: nothing there, nothing to read, or fewer frames than `start_frame`.
            While frames are read, it is raised at an image or packet that is broken.
    """
    if start_frame < 0:
        raise SourceError(f"start frame is {start_frame}; expected 0 or more")
    text = str(spec)
    if isinstance(spec, int) or text.isdigit():
        return CameraSource(int(text), start_frame)
    if text.startswith(STREAM_PREFIXES):
        return ContainerSource(text, start_frame)
    path = Path(text)
    if path.is_dir():
        images = sorted(
            (p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES), key=natural_key
        )
        if not images:
            raise SourceError(
                f"folder {path} holds no images; expected files ending in "
                f"{', '.join(sorted(IMAGE_SUFFIXES))}, or give a video file"
            )
        return ImageSource(path.name, images, start_frame)
    if path.is_file():
        if path.suffix.lower() in IMAGE_SUFFIXES:
            return ImageSource(path.name, [path], start_frame)
        return ContainerSource(text, start_frame)
    if glob.has_magic(text):
        images = sorted((Path(p) for p in glob.glob(text)), key=natural_key)  # noqa: PTH207
        if not images:
            raise SourceError(f"no file matches {text!r}; check the pattern, and quote it")
        return ImageSource(path.parent.name, images, start_frame)
    raise SourceError(
        f"{text!r} does not exist; expected a video file, a folder or glob of images, a camera "
        "index such as 0, or a stream such as rtsp://host/path"
    )


def natural_key(path: Path) -> list[str | int]:
    """Sort key by which `img2` comes before `img10`."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [int(part) if part.isdigit() else part for part in parts]


class _Closing:
    """What all sources share: they close at the end of a `with` block."""

    def close(self) -> None:
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class ContainerSource(_Closing):
    """A video file or a network stream, decoded by FFmpeg."""

    def __init__(self, location: str, start_frame: int) -> None:
        self.name = Path(location).name or location
        self._location, self._start = location, start_frame
        live = location.startswith(STREAM_PREFIXES)
        options = {"rtsp_transport": "tcp"} if location.startswith("rtsp") else {}
        try:
            self._container = av.open(
                location, options=options, timeout=STREAM_TIMEOUT if live else None
            )
        except (FFmpegError, OSError) as error:
            raise SourceError(
                f"{location} cannot be opened as a video: {error.strerror or error}; expected a "
                "file or stream that FFmpeg reads, such as MP4 with H.264"
            ) from error
        if not self._container.streams.video:
            self._container.close()
            raise SourceError(f"{location} has no video in it; expected at least one video track")
        stream = self._container.streams.video[0]
        stream.thread_type = "AUTO"
        self.fps = Fraction(stream.average_rate or stream.guessed_rate or 30)
        self.frame_count = stream.frames or self._estimated_count(stream)
        self._frames = self._decode()
        try:
            self._first = next(self._frames, None)
        except SourceError:
            self.close()
            raise
        if self._first is None:
            self.close()
            raise SourceError(
                f"{location} has no frame {start_frame}; it ends before, after "
                f"{self._decoded} frames"
            )
        height, width = self._first.image.shape[:2]
        self.size = (width, height)

    def __iter__(self) -> Iterator[Frame]:
        if self._first is not None:
            first, self._first = self._first, None
            yield first
        yield from self._frames

    def close(self) -> None:
        self._container.close()

    def _estimated_count(self, stream: av.VideoStream) -> int | None:
        if stream.duration is not None and stream.time_base is not None:
            return round(float(stream.duration * stream.time_base) * self.fps)
        return None

    def _decode(self) -> Iterator[Frame]:
        self._decoded = 0
        start_time: float | None = None
        try:
            for index, frame in enumerate(self._container.decode(video=0)):
                self._decoded = index + 1
                time = frame.time if frame.time is not None else float(index / self.fps)
                start_time = time if start_time is None else start_time
                if index < self._start:
                    continue
                image: NDArray[np.uint8] = frame.to_ndarray(format="bgr24")  # type: ignore[assignment]
                if frame.rotation:  # phones record sideways and say so
                    image = np.ascontiguousarray(np.rot90(image, round(frame.rotation / 90)))
                yield Frame(image, index, time - start_time)
        except FFmpegError as error:
            raise SourceError(
                f"{self._location} is broken after frame {self._decoded - 1}: "
                f"{error.strerror or error}; {self._decoded} frames could be read"
            ) from error


class ImageSource(_Closing):
    """Images in order, read as they are asked for; their sizes may differ."""

    def __init__(self, name: str, paths: list[Path], start_frame: int) -> None:
        self.name = name
        self.fps = IMAGES_FPS
        self.frame_count: int | None = len(paths)
        self._paths, self._start = paths, start_frame
        if start_frame >= len(paths):
            raise SourceError(f"there is no frame {start_frame}; {name} has {len(paths)} images")
        height, width = _read_image(paths[start_frame]).shape[:2]
        self.size = (width, height)

    def __iter__(self) -> Iterator[Frame]:
        for index, path in enumerate(self._paths[self._start :], start=self._start):
            yield Frame(_read_image(path), index, float(index / self.fps))

    def close(self) -> None:
        pass


def _read_image(path: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SourceError(f"{path} cannot be read as an image; restore it or leave it out")
    return image


class CameraSource(_Closing):
    """A camera of this machine, by its index."""

    def __init__(self, index: int, start_frame: int) -> None:
        self.name = f"camera {index}"
        self.frame_count: int | None = None
        self._start = start_frame
        self._capture = cv2.VideoCapture(index)
        if not self._capture.isOpened():
            raise SourceError(
                f"camera {index} cannot be opened; is it plugged in, free, and are you allowed to "
                "use it (on Linux: a member of group video)? If a file was meant, give its path"
            )
        self.fps = Fraction(self._capture.get(cv2.CAP_PROP_FPS) or 30).limit_denominator(1001)
        self.size = (
            int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        while True:
            ok, image = self._capture.read()
            if not ok:
                return
            if index >= self._start:
                yield Frame(image, index, float(index / self.fps))
            index += 1

    def close(self) -> None:
        self._capture.release()
