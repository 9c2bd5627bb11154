"""Real clips in which the object is hidden for a while, to see who takes it back.

Few datasets mark when an object is hidden, and in none can it be hidden for longer or shorter. Here
a window about the object shows another part of the same scene, which does not move: to a tracker
the object passes behind something and comes out somewhere else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence

DURATIONS = (5, 10, 20, 40)
"""Frames that the object is hidden for."""

LEAD = 10
"""Frames that a tracker follows before the object is hidden."""

AFTER = 10
"""Frames after the object is back, until when a tracker has time to take it back."""

MARGIN = 0.2
"""The window reaches this share of the box's side beyond it, on every side."""


@dataclass(frozen=True, eq=False)
class HiddenSequence(Sequence):
    """A sequence in which something hides the object.

    Attributes:
        hidden_from, hidden_to: first frame in which it is hidden, and first in which it is not,
            counted from the start of the track.
    """

    hidden_from: int = 0
    hidden_to: int = 0

    @classmethod
    def of(cls, sequence: Sequence, hidden_from: int, hidden_to: int) -> HiddenSequence:
        """A sequence hidden for some of its frames.

        Raises:
            ValueError: no such frames, or some of them are not annotated.
        """
        if not 0 <= hidden_from < hidden_to <= len(sequence):
            raise ValueError(
                f"frames {hidden_from} to {hidden_to} of sequence {sequence.name!r} cannot be "
                f"hidden: it has {len(sequence)}"
            )
        if not sequence.annotated[hidden_from:hidden_to].all():
            raise ValueError(
                f"the object cannot be hidden in frames {hidden_from} to {hidden_to} of sequence "
                f"{sequence.name!r}: it is not annotated in all of them"
            )
        occluded = np.zeros(len(sequence), dtype=bool)
        occluded[hidden_from:hidden_to] = True
        values = {field.name: getattr(sequence, field.name) for field in fields(Sequence)}
        values["dataset"] = f"{sequence.dataset}-hidden-{hidden_to - hidden_from}"
        values["occluded"] = occluded
        return cls(**values, hidden_from=hidden_from, hidden_to=hidden_to)

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """The frames, uint8 `[H, W, 3]` BGR, the object painted over while it is hidden."""
        backdrop: NDArray[np.uint8] | None = None
        for index, frame in enumerate(super().frames()):
            if backdrop is None:
                backdrop = np.ascontiguousarray(frame[::-1, ::-1])  # the same scene upside down
            if self.hidden_from <= index < self.hidden_to:
                height, width = frame.shape[:2]
                if backdrop.shape != frame.shape:
                    backdrop = cv2.resize(backdrop, (width, height)).reshape(frame.shape)
                x, y, w, h = self.boxes_xywh[index]
                left, top = max(int(x - MARGIN * w), 0), max(int(y - MARGIN * h), 0)
                right, bottom = int(x + (1 + MARGIN) * w) + 1, int(y + (1 + MARGIN) * h) + 1
                frame = frame.copy()
                frame[top:bottom, left:right] = backdrop[top:bottom, left:right]
            yield frame


def hide(sequences: Iterable[Sequence], durations: Iterable[int] = DURATIONS) -> list[Sequence]:
    """Each sequence hidden for each of the durations, from `LEAD` frames after its start.

    A sequence is left out where it is too short for a duration, or where the object is not
    annotated in the frames that it takes.

    Raises:
        ValueError: not one sequence is long enough for any of the durations.
    """
    given = list(sequences)
    found: list[Sequence] = []
    for duration in durations:
        for sequence in given:
            if not sequence.annotated.any():
                continue
            start = int(np.argmax(sequence.annotated)) + LEAD
            needed = sequence.annotated[start : start + duration + AFTER + 1]
            if len(needed) == duration + AFTER + 1 and needed.all():
                found.append(HiddenSequence.of(sequence, start, start + duration))
    if not found:
        raise ValueError(
            f"none of the {len(given)} sequences can be hidden: expected {LEAD} frames, then those "
            f"hidden, then {AFTER + 1}, annotated in one piece"
        )
    return found
