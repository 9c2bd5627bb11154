"""What a tracker reports for one object in one frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Status(str, Enum):
    """How far a reported box is to be believed; derived from the score (see `re3.tracker`)."""

    TRACKED = "tracked"
    UNCERTAIN = "uncertain"
    LOST = "lost"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class Result:
    """One object in one frame.

    Attributes:
        box_xywh: left, top, width, height in pixels of the frame, origin at the top-left corner
            of the top-left pixel. Always finite, width and height positive; may reach outside the
            frame.
        score: expected overlap (IoU) of the box with the object, 0..1. It is 1.0 in the frame
            where the box was given, and NaN of a model that has no score, such as the paper's.
        status: `TRACKED`, `UNCERTAIN` or `LOST`.
        frame_index: 0 for the frame of `init`, then one more for each `update`.
        object_id: the id that `MultiTracker.add` returned; 0 for a single `Tracker`.
        name: the name given to the object, or None.
    """

    box_xywh: tuple[float, float, float, float]
    score: float
    status: Status
    frame_index: int
    object_id: int = 0
    name: str | None = None

    @property
    def label(self) -> str:
        """The object's name, or its id where it has none."""
        return self.name if self.name is not None else str(self.object_id)
