"""Frames from image files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import chain
from pathlib import Path

from re3.video.base import Frame, SourceError, VideoSource
from re3.video.file_kinds import PICTURE, kind_of_file
from re3.video.grey_levels import GreyLevels, Range
from re3.video.image_files import frame_count, read_frames, read_image
from re3.video.image_lists import (
    IMAGE_SUFFIXES,
    is_image,
    notes_on,
    relative_names,
    sorted_images,
)

__all__ = [
    "IMAGES_FPS",
    "IMAGE_SUFFIXES",
    "ImageSource",
    "StackSource",
    "holds_several_frames",
    "is_image",
    "open_image",
    "read_image",
    "sorted_images",
]

IMAGES_FPS = Fraction(30)
"""Frame rate of images, which carry none."""


class ImageSource(VideoSource):
    """Images in order, read as they are asked for; their sizes may differ.

    Args:
        name: for people.
        paths: the images, in order, at least one.
        start_frame: those before are skipped.
        value_range: of 16-bit pixels, as in `re3.video.open_source`.

    Raises:
        SourceError: no image `start_frame`, or it cannot be read.
    """

    has_names = True

    def __init__(
        self,
        name: str,
        paths: Sequence[Path],
        start_frame: int = 0,
        *,
        value_range: Range | None = None,
    ) -> None:
        self.name = name
        self.fps = IMAGES_FPS
        self.frame_count = len(paths)
        self._paths, self._start = paths, start_frame
        self._names = relative_names(paths)
        if start_frame >= len(paths):
            raise SourceError(
                f"there is no frame {start_frame}: {name} has {len(paths)} images; "
                f"expected a start frame from 0 to {len(paths) - 1}"
            )
        self._levels = GreyLevels(value_range)
        height, width = self._first_shape(start_frame)
        self.size = (width, height)
        levels = [] if self._levels.note is None else [f"{name}: {self._levels.note}"]
        self.notes = (*notes_on(name, paths), *levels)

    def __iter__(self) -> Iterator[Frame]:
        for index in range(self._start, len(self._paths)):
            image = read_image(self._paths[index], self._levels)
            yield Frame(image, index, float(index / self.fps), name=self._names[index])

    def close(self) -> None:
        pass

    def _first_shape(self, start_frame: int) -> tuple[int, int]:
        """Height and width of the first frame given; the range is that of the very first image."""
        probe = GreyLevels(self._levels.given)
        image = read_image(self._paths[start_frame], probe)
        if probe.fixed and start_frame > 0:
            read_image(self._paths[0], self._levels)
        elif probe.fixed:
            self._levels = probe
        return image.shape[:2]


class StackSource(VideoSource):
    """The frames of one image file that has several: a TIFF stack, animated WebP or PNG.

    Args:
        path: of the file.
        start_frame: those before are skipped.
        value_range: of 16-bit pixels, as in `re3.video.open_source`.

    Raises:
        SourceError: no frame `start_frame`, or it cannot be read.
    """

    has_names = True

    def __init__(
        self, path: Path, start_frame: int = 0, *, value_range: Range | None = None
    ) -> None:
        self.name = path.name
        self.frame_count = frame_count(path)
        if start_frame >= self.frame_count:
            raise SourceError(
                f"there is no frame {start_frame}: {path.name} has {self.frame_count} frames; "
                f"expected a start frame from 0 to {self.frame_count - 1}"
            )
        levels = GreyLevels(value_range)
        frames = read_frames(path, levels)
        # Read from the very first on, which gives the range of 16-bit pixels and the times.
        first = next(frames)
        self.fps = IMAGES_FPS if first[1] is None else _rate(first[1])
        self._frames = self._timed(chain((first,), frames), start_frame)
        start = next(self._frames)
        self._frames = chain((start,), self._frames)
        height, width = start.image.shape[:2]
        self.size = (width, height)
        self.notes = () if levels.note is None else (f"{self.name}: {levels.note}",)

    def __iter__(self) -> Iterator[Frame]:
        yield from self._frames

    def close(self) -> None:
        self._frames = iter(())

    def _timed(self, frames: Iterator[tuple[object, float | None]], start: int) -> Iterator[Frame]:
        time = 0.0
        for index, (image, seconds) in enumerate(frames):
            if index >= start:
                yield Frame(image, index, time, name=self.name)  # type: ignore[arg-type]
            time = float((index + 1) / self.fps) if seconds is None else time + float(seconds)


def open_image(
    path: Path, start_frame: int = 0, *, value_range: Range | None = None
) -> VideoSource:
    """All frames of one image file, be it one or several.

    Raises:
        SourceError: no frame `start_frame`, or it cannot be read.
    """
    if frame_count(path) > 1:
        return StackSource(path, start_frame, value_range=value_range)
    return ImageSource(path.name, [path], start_frame, value_range=value_range)


def holds_several_frames(path: Path) -> bool:
    """Whether the file is an image of several frames, whatever its name: FFmpeg reads the first."""
    return path.is_file() and kind_of_file(path) == PICTURE and frame_count(path) > 1


def _rate(seconds: float) -> Fraction:
    return 1 / Fraction(seconds).limit_denominator(1000)
