"""Results that are one document: JSON and COCO-style JSON. They are written whole or not at all."""

from __future__ import annotations

import json
from abc import abstractmethod
from pathlib import Path
from typing import IO

from re3.video.partial import PartialFile
from re3.video.results_base import DAMAGED_FIELD, IMAGE_FIELD, ResultsWriter, Row


class _Document(ResultsWriter):
    """One file, opened at the first frame."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self._partial: PartialFile | None = None
        self._stream: IO[str] | None = None

    @property
    def paths(self) -> list[Path]:
        """See `ResultsWriter`."""
        return [self.path] if self.frames_written else []

    def _write_rows(self, rows: list[Row], size: tuple[int, int] | None) -> None:
        if self._stream is None:
            self._partial = PartialFile(self.path)
            self._stream = self._partial.path.open("w", encoding="utf-8", newline="")
        self._stream.write(self._text(rows, size))

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
    def _text(self, rows: list[Row], size: tuple[int, int] | None) -> str:
        """The rows of one frame as they stand in the file."""

    @abstractmethod
    def _end(self) -> str:
        """What completes the document."""


class Json(_Document):
    """One array of the same objects that JSON Lines has."""

    _separator = "[\n"

    def _text(self, rows: list[Row], size: tuple[int, int] | None) -> str:
        text = ""
        for row in rows:
            text += self._separator + json.dumps(row)
            self._separator = ",\n"
        return text

    def _end(self) -> str:
        return "[]\n" if self._separator == "[\n" else "\n]\n"


class Coco(_Document):
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

    def _text(self, rows: list[Row], size: tuple[int, int] | None) -> str:
        for row in rows[:1]:
            # A frame of a video has no file: its name is the one it would be saved under.
            name = row.get(IMAGE_FIELD, f"{row['frame']:06d}.jpg")
            image = {"id": row["frame"] + 1, "file_name": name}
            if size is not None:
                image |= {"width": size[0], "height": size[1]}
            kept = ("frame", "timestamp", DAMAGED_FIELD)
            self._images.append(image | {name: row[name] for name in kept if name in row})
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
