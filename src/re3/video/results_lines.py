"""Results of lines: CSV, JSON Lines, MOTChallenge and OTB text."""

from __future__ import annotations

import csv
import io
import json
import sys
from abc import abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO

from re3.csv_text import csv_text
from re3.video.partial import PartialFile
from re3.video.results_base import DAMAGED_FIELD, FIELDS, ResultsWriter, Row

ABSENT = "nan,nan,nan,nan\n"
"""Line of OTB text for a frame without the object."""


class GrowingFile:
    """A file of lines; what is appended is in it at once, whole or not at all.

    Args:
        target: where the file is to appear.
        live: whether it grows under its name, or appears there when it is closed.
    """

    def __init__(self, target: Path, live: bool) -> None:
        self._live = live
        self._partial = PartialFile(target, under_its_name=live)
        self._file = self._partial.path.open("wb", buffering=0)
        self._size = 0

    def append(self, lines: str) -> None:
        """Write complete lines.

        Raises:
            OSError: they cannot be written; what was of them is taken back.
        """
        data = lines.encode()
        written = 0
        try:
            while written < len(data):  # a disk that is nearly full takes a part
                written += self._file.write(data[written:]) or 0
        except OSError:
            self._file.truncate(self._size)
            raise
        self._size += written

    def move(self, target: Path) -> None:
        """Let it have another name."""
        self._file.close()
        earlier, self._partial = self._partial, PartialFile(target, under_its_name=self._live)
        earlier.path.replace(self._partial.path)
        self._file = self._partial.path.open("ab", buffering=0)

    def rewrite(self, change: Callable[[IO[str], IO[str]], None]) -> None:
        """Put a changed copy in the place of what there is.

        Args:
            change: reads what there is from the first file and writes to the second.
        """
        self._file.close()
        copy = PartialFile(self._partial.path)
        try:
            with (
                self._partial.path.open(encoding="utf-8", newline="") as earlier,
                copy.path.open("w", encoding="utf-8", newline="") as rewritten,
            ):
                change(earlier, rewritten)
            copy.commit()
        finally:
            copy.discard()

    def close(self, *, keep: bool) -> None:
        """Close it; to `keep` it, it is under its name from here on, else it is removed."""
        self._file.close()
        if keep:
            self._partial.commit()
        else:
            self._partial.discard()


def _csv_text(rows: list[Row], fields: Sequence[str], header: bool) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, fields, lineterminator="\n", extrasaction="ignore")
    if header:
        writer.writeheader()
    names = ("object", "image")
    writer.writerows(
        {name: csv_text(value) if name in names and value else value for name, value in row.items()}
        for row in rows
    )
    return text.getvalue()


class CsvToStdout(ResultsWriter):
    """CSV on standard output."""

    @property
    def paths(self) -> list[Path]:
        """See `ResultsWriter`."""
        return []

    def _write_rows(self, rows: list[Row], size: tuple[int, int] | None) -> None:
        fields = (*FIELDS, *self.extra_fields)
        sys.stdout.write(_csv_text(rows, fields, header=self.frames_written == 0))
        sys.stdout.flush()  # who reads the pipe wants each frame when it is there

    def _finish(self) -> None:
        pass


class _LineFile(ResultsWriter):
    """One file, opened at the first frame."""

    def __init__(self, path: Path, live: bool) -> None:
        super().__init__()
        self.path = path
        self._live = live
        self._file: GrowingFile | None = None

    @property
    def paths(self) -> list[Path]:
        """See `ResultsWriter`."""
        return [self.path] if self.frames_written else []

    def _write_rows(self, rows: list[Row], size: tuple[int, int] | None) -> None:
        if self._file is None:
            self._file = GrowingFile(self.path, self._live)
        self._file.append(self._text(rows))

    def _finish(self) -> None:
        if self._file is not None:
            self._file.close(keep=self.frames_written > 0)

    @abstractmethod
    def _text(self, rows: list[Row]) -> str:
        """The rows of one frame as they stand in the file."""


class Csv(_LineFile):
    """CSV with a header.

    Where frames were damaged, a column that marks them with 1 is added at the end: a file that
    grows has room for no more columns.
    """

    def __init__(self, path: Path, live: bool) -> None:
        super().__init__(path, live)
        self._damaged: set[str] = set()

    def _text(self, rows: list[Row]) -> str:
        self._damaged.update(str(row["frame"]) for row in rows if DAMAGED_FIELD in row)
        return _csv_text(rows, (*FIELDS, *self.extra_fields), header=self.frames_written == 0)

    def _finish(self) -> None:
        if self._file is not None and self._damaged:
            self._file.rewrite(self._with_damage)
        super()._finish()

    def _with_damage(self, earlier: IO[str], rewritten: IO[str]) -> None:
        writer = csv.writer(rewritten, lineterminator="\n")
        for number, row in enumerate(csv.reader(earlier)):
            added = DAMAGED_FIELD if number == 0 else str(int(row[0] in self._damaged))
            writer.writerow([*row, added])


class JsonLines(_LineFile):
    """An object of JSON a line."""

    def _text(self, rows: list[Row]) -> str:
        return "".join(json.dumps(row) + "\n" for row in rows)


class Mot(_LineFile):
    """`frame,id,left,top,width,height,score,-1,-1,-1`, 1-based (Leal-Taixé et al. 2015).

    An id is the place of the object's label among those met so far. A score that a model does not
    have is 1.
    """

    def __init__(self, path: Path, live: bool) -> None:
        super().__init__(path, live)
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


class Otb(ResultsWriter):
    """`x,y,w,h` a line a frame. With several objects each has a file of its own, `name-object`."""

    def __init__(self, path: Path, live: bool) -> None:
        super().__init__()
        self.path = path
        self._live = live
        self._files: dict[str, GrowingFile] = {}

    @property
    def paths(self) -> list[Path]:
        """See `ResultsWriter`."""
        return self._paths_of(list(self._files))

    def _paths_of(self, labels: list[str]) -> list[Path]:
        """A file for each object; those of the first stay the same when there are more."""
        if len(labels) < 2:
            return [self.path] if labels else []
        names: dict[str, None] = {}
        for label in labels:
            name = "".join(c if c.isalnum() or c in "-_." else "_" for c in label)
            while name in names:  # "a b" and "a/b" are two objects
                name += "_"
            names[name] = None
        return [self.path.with_stem(f"{self.path.stem}-{name}") for name in names]

    def _write_rows(self, rows: list[Row], size: tuple[int, int] | None) -> None:
        boxes = {row["object"]: ",".join(f"{row[s]:.3f}" for s in "xywh") + "\n" for row in rows}
        labels = list(dict.fromkeys([*self._files, *boxes]))
        if len(labels) > len(self._files):
            self._add_files(labels)
        for label, file in self._files.items():
            file.append(boxes.get(label, ABSENT))

    def _add_files(self, labels: list[str]) -> None:
        paths = self._paths_of(labels)
        if len(self._files) == 1:  # the name was for a single object
            self._files[labels[0]].move(paths[0])
        for label, path in list(zip(labels, paths, strict=True))[len(self._files) :]:
            self._files[label] = GrowingFile(path, self._live)
            self._files[label].append(ABSENT * self.frames_written)

    def _finish(self) -> None:
        for file in self._files.values():
            file.close(keep=self.frames_written > 0)
