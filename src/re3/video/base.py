"""What every source of frames is: an iterable of frames that knows its rate and size."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray


class SourceError(ValueError):
    """A source cannot be opened or read; the message says what was found and what to do."""


# Without eq=False the generated __eq__ would compare images and fail on their truth value.
@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One frame.

    Attributes:
        image: uint8 `[H, W, 3]` BGR.
        index: 0-based in the source, so that with `start_frame=30` the first is 30.
        timestamp: seconds from the source's first frame; never less than that of the frame before.
        damaged: whether the decoder marked the image as corrupt: part of it is concealed.
        name: of the image file, relative to the folder of the source; None of video.
    """

    image: NDArray[np.uint8]
    index: int
    timestamp: float
    damaged: bool = False
    name: str | None = None


class VideoSource(ABC):
    """An iterable of frames, to be walked once, and a context manager that closes it.

    Iterating raises `SourceError` where the source turns out to be broken, after the frames
    before that place.

    Attributes:
        name: short, for people; without the password of a stream.
        fps: frames a second.
        size: width and height in pixels of the first frame delivered.
        frame_count: of the whole source, `start_frame` or not, where it is known, else None. Of a
            video file it is what the file says of itself, which may be an estimate.
        pixel_aspect: width of a pixel divided by its height, as the source is to be shown. Boxes
            and sizes are always in stored pixels.
        notes: sentences on what is unusual about the source, for the user.
        has_names: whether frames have a name.
    """

    name: str
    fps: Fraction
    size: tuple[int, int]
    frame_count: int | None
    pixel_aspect: Fraction = Fraction(1)
    notes: tuple[str, ...] = ()
    has_names: bool = False

    @property
    def skipped(self) -> int:
        """Packets left out so far because they cannot be decoded, usually one frame each."""
        return 0

    @property
    def length_is_certain(self) -> bool:
        """Whether the announced length is that of the video; a file's may be its sound's."""
        return True

    def missing_frames(self, last: Frame) -> int:
        """Frames that the source announced and did not give.

        Args:
            last: the last frame that it gave.
        """
        return 0 if self.frame_count is None else max(0, self.frame_count - (last.index + 1))

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """The frames from `start_frame` on."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the file or device; no frames come afterwards."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class FirstFrameKept(VideoSource):
    """A source whose first frame can be looked at before it is walked.

    Args:
        source: not walked yet; closed with this one.

    Attributes:
        first: its first frame.

    Raises:
        SourceError: it has none.
    """

    def __init__(self, source: VideoSource) -> None:
        self.name, self.fps = source.name, source.fps
        self.size, self.frame_count = source.size, source.frame_count
        self.pixel_aspect, self.notes = source.pixel_aspect, source.notes
        self.has_names = source.has_names
        self._source, self._rest = source, iter(source)
        first = next(self._rest, None)
        if first is None:
            raise SourceError(f"{source.name} gave no frame; expected at least one")
        self.first = first

    def __iter__(self) -> Iterator[Frame]:
        yield self.first
        yield from self._rest

    def close(self) -> None:
        """See `VideoSource`."""
        self._source.close()

    @property
    def skipped(self) -> int:
        """See `VideoSource`."""
        return self._source.skipped

    @property
    def length_is_certain(self) -> bool:
        """See `VideoSource`."""
        return self._source.length_is_certain

    def missing_frames(self, last: Frame) -> int:
        """See `VideoSource`."""
        return self._source.missing_frames(last)
