"""Results out: CSV, JSON, JSON Lines, OTB and MOTChallenge text, COCO-style JSON.

Files are written whole or not at all.
"""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from re3.csv_text import csv_text
from re3.result import Result
from re3.video.partial import PartialFile

FIELDS = ("frame", "timestamp", "object", "x", "y", "w", "h", "score", "status")
STDOUT = "-"
ABSENT = "nan,nan,nan,nan\n"
"""Line of OTB text for a frame without the object."""

Row = dict[str, Any]


def open_results(path: str | Path) -> ResultsWriter:
    """A writer chosen by the file's ending; used as a context manager.

    Args:
        path: ending in .csv, .jsonl, .json, .txt (OTB), .mot.txt (MOTChallenge) or .coco.json;
            "-" writes CSV to standard output.

    Raises:
        ValueError: another ending, or a folder.
    """
    if str(path) == STDOUT:
        return _CsvToStdout()
    path = Path(path)
    kinds: dict[str, Callable[[Path], ResultsWriter]] = {
        ".mot.txt": _Mot,
        ".coco.json": _Coco,
        ".csv": _Csv,
        ".jsonl": _JsonLines,
        ".json": _Json,
        ".txt": _Otb,
    }
    ending = next((each for each in kinds if path.name.lower().endswith(each)), None)
    if ending is None:
        raise ValueError(
            f"results {path} end in {path.suffix!r}; expected one of "
            f"{', '.join(sorted(kinds, key=len))}, or - for CSV on standard output"
        )
    if path.is_dir():
        raise ValueError(f"results {path} is a folder; expected the path of a file")
    return kinds[ending](path)


class ResultsWriter(ABC):
    """Writes the results of one frame after the other.

    A context manager. The file appears under its name when the block ends, also when it ends by
    an exception or Ctrl-C, with the frames so far; each frame is there with all its objects or
    not at all. Without any frame no file appears, and an older one stays.

    Attributes:
        frames_written: so far.
        frame_size: width and height in pixels; COCO-style JSON names them where they are set.
    """

    def __init__(self) -> None:
        self.frames_written = 0
        self.frame_size: tuple[int, int] | None = None

    def write(self, frame_index: int, timestamp: float, results: Iterable[Result]) -> None:
        """Append a frame.

        Args:
            frame_index: 0-based in the source.
            timestamp: in seconds.
            results: of the frame's objects.

        Raises:
            ValueError: two of the objects have the same label.
            OSError: the file cannot be written.
        """
        rows = [_row(frame_index, timestamp, result) for result in results]
        labels = [row["object"] for row in rows]
        if len(set(labels)) < len(labels):
            raise ValueError(
                f"frame {frame_index} has objects of the same label: {', '.join(labels)}; "
                "give each object a name of its own"
            )
        self._write_rows(rows)
        self.frames_written += 1

    @property
    @abstractmethod
    def paths(self) -> list[Path]:
        """The files that there are after the block."""

    @abstractmethod
    def _write_rows(self, rows: list[Row]) -> None:
        """Append the rows of one frame."""

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


def _csv_text(rows: list[Row], header: bool) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, FIELDS, lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows({**row, "object": csv_text(row["object"])} for row in rows)
    return text.getvalue()


class _CsvToStdout(ResultsWriter):
    @property
    def paths(self) -> list[Path]:
        return []

    def _write_rows(self, rows: list[Row]) -> None:
        sys.stdout.write(_csv_text(rows, header=self.frames_written == 0))
        sys.stdout.flush()  # who reads the pipe wants each frame when it is there

    def _finish(self) -> None:
        pass


class _TextFile(ResultsWriter):
    """One file, opened at the first frame."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self._partial: PartialFile | None = None
        self._stream: IO[str] | None = None

    @property
    def paths(self) -> list[Path]:
        return [self.path] if self.frames_written else []

    def _write_rows(self, rows: list[Row]) -> None:
        if self._stream is None:
            self._partial = PartialFile(self.path)
            self._stream = self._partial.path.open("w", encoding="utf-8", newline="")
        self._stream.write(self._text(rows))  # at once, so that no frame is torn

    def _finish(self) -> None:
        if self._partial is None or self._stream is None:
            return
        try:
            with self._stream:
                self._stream.write(self._end())
            if self.frames_written:
                self._partial.commit()
        finally:
            self._partial.discard()

    @abstractmethod
    def _text(self, rows: list[Row]) -> str:
        """The rows of one frame as they stand in the file."""

    def _end(self) -> str:
        return ""


class _Csv(_TextFile):
    def _text(self, rows: list[Row]) -> str:
        return _csv_text(rows, header=self.frames_written == 0)


class _JsonLines(_TextFile):
    def _text(self, rows: list[Row]) -> str:
        return "".join(json.dumps(row) + "\n" for row in rows)


class _Json(_TextFile):
    """One array of the same objects that JSON Lines has."""

    _separator = "[\n"

    def _text(self, rows: list[Row]) -> str:
        text = ""
        for row in rows:
            text += self._separator + json.dumps(row)
            self._separator = ",\n"
        return text

    def _end(self) -> str:
        return "[]\n" if self._separator == "[\n" else "\n]\n"


class _Mot(_TextFile):
    """`frame,id,left,top,width,height,score,-1,-1,-1`, 1-based (Leal-Taixé et al. 2015).

    An id is the place of the object's label among those met so far. A score that a model does not
    have is 1.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._ids: dict[str, int] = {}

    def _text(self, rows: list[Row]) -> str:
        lines = []
        for row in rows:
            identity = self._ids.setdefault(row["object"], len(self._ids) + 1)
            score = 1 if row["score"] is None else row["score"]
            lines.append(
                f"{row['frame'] + 1},{identity},{row['x'] + 1:.3f},{row['y'] + 1:.3f},"
                f"{row['w']:.3f},{row['h']:.3f},{score},-1,-1,-1\n"
            )
        return "".join(lines)


class _Coco(_TextFile):
    """COCO's instances file (Lin et al. 2014): a category an object, an image a frame.

    Beyond COCO, an annotation has `score`, `status` and `track_id`, an image `frame` (0-based) and
    `timestamp`. Images are the frames in which an object was followed. Kept in memory until the
    end, as the three lists lie one behind the other: about 200 bytes a box.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._ids: dict[str, int] = {}
        self._images: list[Row] = []
        self._annotations: list[Row] = []

    def _text(self, rows: list[Row]) -> str:
        for row in rows[:1]:
            image = {"id": row["frame"] + 1, "file_name": f"{row['frame']:06d}.jpg"}
            if self.frame_size is not None:
                image |= {"width": self.frame_size[0], "height": self.frame_size[1]}
            self._images.append(image | {name: row[name] for name in ("frame", "timestamp")})
        for row in rows:
            identity = self._ids.setdefault(row["object"], len(self._ids) + 1)
            self._annotations.append(
                {
                    "id": len(self._annotations) + 1,
                    "image_id": row["frame"] + 1,
                    "category_id": identity,
                    "track_id": identity,
                    "bbox": [row[side] for side in "xywh"],
                    "area": round(row["w"] * row["h"], 3),
                    "iscrowd": 0,
                    "score": row["score"],
                    "status": row["status"],
                }
            )
        return ""

    def _end(self) -> str:
        categories = [{"id": identity, "name": label} for label, identity in self._ids.items()]
        whole = {
            "images": self._images,
            "annotations": self._annotations,
            "categories": categories,
        }
        return json.dumps(whole, indent=1) + "\n"


class _Otb(ResultsWriter):
    """`x,y,w,h` a line a frame. With several objects each has a file of its own, `name-object`.

    Kept in memory until the end, when it is known how many objects there are: 30 bytes a line.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self._lines: dict[str, list[str]] = {}

    @property
    def paths(self) -> list[Path]:
        if len(self._lines) < 2:
            return [self.path] if self._lines else []
        names: dict[str, None] = {}
        for label in self._lines:
            name = "".join(c if c.isalnum() or c in "-_." else "_" for c in label)
            while name in names:  # "a b" and "a/b" are two objects
                name += "_"
            names[name] = None
        return [self.path.with_stem(f"{self.path.stem}-{name}") for name in names]

    def _write_rows(self, rows: list[Row]) -> None:
        boxes = {row["object"]: ",".join(f"{row[s]:.3f}" for s in "xywh") + "\n" for row in rows}
        for label in boxes:
            self._lines.setdefault(label, [ABSENT] * self.frames_written)
        for label, lines in self._lines.items():
            lines.append(boxes.get(label, ABSENT))

    def _finish(self) -> None:
        for path, lines in zip(self.paths, self._lines.values(), strict=True):
            partial = PartialFile(path)
            try:
                partial.path.write_text("".join(lines), encoding="utf-8")
                partial.commit()
            finally:
                partial.discard()
