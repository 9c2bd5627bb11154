"""What a tracker reports for one object in one frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Status(str, Enum):
    """How far a reported box is to be believed; derived from the score (see `re3.confidence`)."""

    TRACKED = "tracked"
    UNCERTAIN = "uncertain"
    LOST = "lost"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True, repr=False)
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
        object_id: the id that `MultiTracker.add` returned; a `Tracker` counts its calls of `init`.
        name: the name given to the object, or None.

    Examples:
        >>> tracker.update(frame)
        Result(box_xywh=(373.1, 50.0, 157.2, 375.1), score=0.90, status=TRACKED, frame_index=1,
               object_id=1)
        >>> print(tracker.update(frame))
        object 1, frame 2: 154.3 x 379.6 at (377.6, 43.5), score 0.87, tracked
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

    def __repr__(self) -> str:
        """All fields, rounded for reading; those left at their default are left out."""
        box = ", ".join(f"{value:.1f}" for value in self.box_xywh)
        text = (
            f"box_xywh=({box}), score={self.score:.2f}, status={self.status.name}, "
            f"frame_index={self.frame_index}"
        )
        if self.object_id:
            text += f", object_id={self.object_id}"
        if self.name is not None:
            text += f", name={self.name!r}"
        return f"Result({text})"

    def __str__(self) -> str:
        """One line for people."""
        x, y, w, h = self.box_xywh
        who = f"object {self.object_id}" if self.name is None else self.name
        return (
            f"{who}, frame {self.frame_index}: {w:.1f} x {h:.1f} at ({x:.1f}, {y:.1f}), "
            f"score {self.score:.2f}, {self.status}"
        )
