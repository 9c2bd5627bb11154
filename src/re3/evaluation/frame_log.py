"""What a tracker gave for each frame, kept while it runs and, if asked, on disk as it comes."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FIELDS = 11
_FIELDS_BEFORE = 9
"""Of journals written before the time of crops and network was kept."""
_NAN = float("nan")


class Step(IntEnum):
    """What a frame was to the tracker."""

    FOLLOWED = 0
    STARTED = 1
    FAILED = 2
    SKIPPED = 3


class FrameLog:
    """The frames of one run of one tracker over one sequence.

    Frames of which nothing is said are `SKIPPED`, without box, score or times.

    Args:
        frames: how many the sequence has, T.
        journal: gets a line for each frame as soon as it is known, flushed, so that nothing is
            lost of a process that is killed; `FrameLog.read` reads it.
        on_frame: called with the number of frames done, after each.

    Attributes:
        boxes_xywh: float64 `[T, 4]` in pixels, NaN without a box.
        steps: int8 `[T]` of `Step`.
        scores, seconds, decode_seconds: float64 `[T]`, NaN where there is none.
        crop_seconds, network_seconds: float64 `[T]`, the parts of `seconds` that a tracker tells
            of, NaN where it does not.
        done: number of frames known.
    """

    def __init__(
        self,
        frames: int,
        journal: TextIO | None = None,
        on_frame: Callable[[int], None] | None = None,
    ) -> None:
        self.boxes_xywh = np.full((frames, 4), np.nan)
        self.steps = np.full(frames, Step.SKIPPED, dtype=np.int8)
        self.scores = np.full(frames, np.nan)
        self.seconds = np.full(frames, np.nan)
        self.decode_seconds = np.full(frames, np.nan)
        self.crop_seconds = np.full(frames, np.nan)
        self.network_seconds = np.full(frames, np.nan)
        self.done = 0
        self._journal = journal
        self._on_frame = on_frame

    def add(
        self,
        index: int,
        step: Step,
        box_xywh: ArrayLike | None = None,
        score: float = _NAN,
        seconds: float = _NAN,
        decode_seconds: float = _NAN,
        crop_seconds: float = _NAN,
        network_seconds: float = _NAN,
    ) -> None:
        """Note a frame; frames come in order."""
        self.steps[index] = step
        if box_xywh is not None:
            self.boxes_xywh[index] = box_xywh
        numbers = (score, seconds, decode_seconds, crop_seconds, network_seconds)
        for column, number in zip(self._columns, numbers, strict=True):
            column[index] = number
        self.done = index + 1
        if self._journal is not None:
            row = (*self.boxes_xywh[index].tolist(), *numbers)
            # repr() is the shortest text that reads back as the same number.
            text = ",".join(repr(float(value)) for value in row)
            self._journal.write(f"{index},{int(step)},{text}\n")
            self._journal.flush()
        if self._on_frame is not None:
            self._on_frame(self.done)

    @classmethod
    def read(cls, path: Path, frames: int) -> FrameLog:
        """The log of a journal, also of an older one; a last line that was cut off is left out."""
        log = cls(frames)
        if not path.is_file():
            return log
        for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
            fields = line.split(",")
            if not line.endswith("\n") or len(fields) not in (_FIELDS, _FIELDS_BEFORE):
                break
            numbers = [float(field) for field in fields[2:]]
            known = None if math.isnan(numbers[0]) else numbers[:4]
            log.add(int(fields[0]), Step(int(fields[1])), known, *numbers[4:])
        return log

    @property
    def _columns(self) -> tuple[NDArray[np.float64], ...]:
        return (
            self.scores,
            self.seconds,
            self.decode_seconds,
            self.crop_seconds,
            self.network_seconds,
        )
