"""Timestamps that go on where those of a recording begin again."""

from __future__ import annotations

from fractions import Fraction

JUMP_SECONDS = 10.0
"""A step forward of more than this is a second recording, in formats whose clock may jump."""

REORDERED_FRAMES = 3
"""A step back of at most so many frames is a wrong timestamp, not another recording."""


class Timeline:
    """Seconds from the first frame, made continuous.

    A stream that was joined from several recordings has clocks that begin again: the frame after
    such a place follows the one before it at the frame rate.

    Args:
        fps: frames a second.
        may_jump: whether the clock may also jump forward, as in MPEG transport streams.
    """

    def __init__(self, fps: Fraction, may_jump: bool) -> None:
        self._interval = float(1 / fps)
        self._may_jump = may_jump
        self._offset: float | None = None
        self._latest: float | None = None

    def seconds(self, time: float | None) -> float:
        """The timestamp of the next frame.

        Args:
            time: as the stream gives it, in seconds; where it gives none, the frame follows the
                one before at the frame rate.
        """
        following = 0.0 if self._latest is None else self._latest + self._interval
        if time is None:
            self._latest = following
            return following
        if self._latest is None or self._offset is None:
            self._offset = following - time
        else:
            step = time + self._offset - self._latest
            back = step < -REORDERED_FRAMES * self._interval
            if back or (self._may_jump and step > JUMP_SECONDS):
                self._offset = following - time
        self._latest = max(self._latest or 0.0, time + self._offset)
        return self._latest
