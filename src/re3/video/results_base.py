"""What every writer of results is, and the row that it writes for an object in a frame."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from re3.result import Result

FIELDS = ("frame", "timestamp", "object", "x", "y", "w", "h", "score", "status")
IMAGE_FIELD = "image"
DAMAGED_FIELD = "damaged"

Row = dict[str, Any]


class ResultsWriter(ABC):
    """Writes the results of one frame after the other.

    A context manager. The file appears under its name when the block ends, also when it ends by
    an exception or Ctrl-C, with the frames so far; each frame is there with all its objects or
    not at all. Without any frame no file appears, and an older one stays.

    Attributes:
        frames_written: so far.
        frame_size: width and height in pixels; COCO-style JSON names them where they are set.
        extra_fields: columns that CSV has after the usual ones, such as `image`; set them before
            the first frame. The JSON forms need no columns.
    """

    def __init__(self) -> None:
        self.frames_written = 0
        self.frame_size: tuple[int, int] | None = None
        self.extra_fields: tuple[str, ...] = ()

    def write(
        self,
        frame_index: int,
        timestamp: float,
        results: Iterable[Result],
        *,
        image: str | None = None,
        size: tuple[int, int] | None = None,
        damaged: bool = False,
    ) -> None:
        """Append a frame.

        Args:
            frame_index: 0-based in the source.
            timestamp: in seconds.
            results: of the frame's objects.
            image: name of the image file that the frame comes from.
            size: width and height of the frame where they differ from `frame_size`.
            damaged: whether the decoder marked the frame as corrupt.

        Raises:
            ValueError: two of the objects have the same label.
            OSError: the file cannot be written.
        """
        extra: Row = {} if image is None else {IMAGE_FIELD: image}
        if damaged:
            extra[DAMAGED_FIELD] = True
        rows = [_row(frame_index, timestamp, result) | extra for result in results]
        labels = [row["object"] for row in rows]
        if len(set(labels)) < len(labels):
            raise ValueError(
                f"frame {frame_index} has objects of the same label: {', '.join(labels)}; "
                "give each object a name of its own"
            )
        self._write_rows(rows, size or self.frame_size)
        self.frames_written += 1

    @property
    @abstractmethod
    def paths(self) -> list[Path]:
        """The files that there are after the block."""

    @abstractmethod
    def _write_rows(self, rows: list[Row], size: tuple[int, int] | None) -> None:
        """Append the rows of one frame, of that width and height."""

    @abstractmethod
    def _finish(self) -> None:
        """Complete the files and let them appear."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._finish()


def _row(frame_index: int, timestamp: float, result: Result) -> Row:
    x, y, w, h = (round(value, 3) for value in result.box_xywh)
    # A model without score has NaN, which JSON cannot say.
    score = None if math.isnan(result.score) else round(result.score, 4)
    values = (
        frame_index,
        round(timestamp, 6),
        result.label,
        x,
        y,
        w,
        h,
        score,
        result.status.value,
    )
    return dict(zip(FIELDS, values, strict=True))
