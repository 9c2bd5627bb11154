"""Results out: CSV, JSON, JSON Lines and OTB text, written whole or not at all."""

from __future__ import annotations

import csv
import json
import math
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from re3.result import Result

FIELDS = ("frame", "timestamp", "object", "x", "y", "w", "h", "score", "status")
STDOUT = "-"


def open_results(path: str | Path) -> ResultsWriter:
    """A writer chosen by the file's ending; used as a context manager.

    Args:
        path: ending in .csv, .jsonl, .json or .txt; "-" writes CSV to standard output.

    Raises:
        ValueError: another ending.
    """
    if str(path) == STDOUT:
        return _Csv(None)
    path = Path(path)
    kinds: dict[str, Callable[[Path], ResultsWriter]] = {
        ".csv": _Csv,
        ".jsonl": _JsonLines,
        ".json": _Json,
        ".txt": _Otb,
    }
    if path.suffix.lower() not in kinds:
        raise ValueError(
            f"results {path} end in {path.suffix!r}; expected one of {', '.join(kinds)}, "
            "or - for CSV on standard output"
        )
    return kinds[path.suffix.lower()](path)


class ResultsWriter:
    """Writes the results of one frame after the other.

    A context manager. The file appears under its name when the block ends, also when it ends by
    an exception or Ctrl-C, with the frames so far. Without any frame no file appears.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.frames_written = 0
        self._stream: IO[str] | None = None

    def write(self, frame_index: int, timestamp: float, results: Iterable[Result]) -> None:
        """Append a frame.

        Args:
            frame_index: 0-based in the source.
            timestamp: in seconds.
            results: of the frame's objects.
        """
        for result in results:
            self._write_row(_row(frame_index, timestamp, result))
        self.frames_written += 1

    @property
    def paths(self) -> list[Path]:
        """The files that there are after the block."""
        return [self.path] if self.path is not None and self.frames_written else []

    def __enter__(self) -> Self:
        if self.path is None:
            self._stream = sys.stdout
        else:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self._partial.open("w", encoding="utf-8", newline="")
        self._begin()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._stream is not None
        self._end()
        if self.path is None:
            self._stream.flush()
            return
        self._stream.close()
        if self.frames_written:
            self._partial.replace(self.path)
        else:
            self._partial.unlink()

    @property
    def _partial(self) -> Path:
        assert self.path is not None
        return self.path.with_name(f".{self.path.name}.{os.getpid()}.partial")

    def _begin(self) -> None:
        pass

    def _end(self) -> None:
        pass

    def _write_row(self, row: dict[str, Any]) -> None:
        raise NotImplementedError


def _row(frame_index: int, timestamp: float, result: Result) -> dict[str, Any]:
    x, y, w, h = (round(value, 3) for value in result.box_xywh)
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


class _Csv(ResultsWriter):
    def _begin(self) -> None:
        assert self._stream is not None
        self._csv = csv.DictWriter(self._stream, FIELDS, lineterminator="\n")
        self._csv.writeheader()

    def _write_row(self, row: dict[str, Any]) -> None:
        self._csv.writerow(row)


class _JsonLines(ResultsWriter):
    def _write_row(self, row: dict[str, Any]) -> None:
        assert self._stream is not None
        self._stream.write(json.dumps(row) + "\n")


class _Json(ResultsWriter):
    """One array of the same objects that JSON Lines has."""

    def _begin(self) -> None:
        assert self._stream is not None
        self._stream.write("[")
        self._separator = "\n"

    def _write_row(self, row: dict[str, Any]) -> None:
        assert self._stream is not None
        self._stream.write(self._separator + json.dumps(row))
        self._separator = ",\n"

    def _end(self) -> None:
        assert self._stream is not None
        self._stream.write("\n]\n")


class _Otb(ResultsWriter):
    """`x,y,w,h` a line a frame. With several objects each has a file of its own, `name-object`."""

    def __enter__(self) -> Self:
        assert self.path is not None
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._lines: dict[str, list[str]] = {}
        return self

    def _write_row(self, row: dict[str, Any]) -> None:
        box = ",".join(f"{row[side]:.3f}" for side in "xywh")
        self._lines.setdefault(row["object"], []).append(box + "\n")

    @property
    def paths(self) -> list[Path]:
        assert self.path is not None
        if len(self._lines) < 2:
            return [self.path] if self._lines else []
        safe = {label: "".join(c if c.isalnum() else "_" for c in label) for label in self._lines}
        return [self.path.with_stem(f"{self.path.stem}-{safe[label]}") for label in self._lines]

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for path, lines in zip(self.paths, self._lines.values(), strict=True):
            partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
            partial.write_text("".join(lines), encoding="utf-8")
            partial.replace(path)
