"""States of the tracker by frame, so that it can go on from any frame; bounded in memory."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import NDArray

BUDGET = 96 << 20
"""Bytes; a state of re3-lite with one object takes 170 kB."""

RECENT = 24
"""Frames before the newest whose states are all kept, budget or not: stepping back is at once."""


class SavedState(NamedTuple):
    """The tracker after a frame.

    Attributes:
        arrays: of `MultiTracker.save_state`.
        ids: object -> its id in the tracker.
    """

    arrays: dict[str, NDArray]
    ids: dict[int, int]


class StateStore:
    """States by frame. Over the budget, older ones are thinned out evenly.

    Args:
        budget: in bytes.
    """

    def __init__(self, budget: int = BUDGET) -> None:
        self._budget = budget
        self._states: dict[int, SavedState] = {}
        self._sizes: dict[int, int] = {}
        self._bytes = 0
        self._stride = 1

    def put(self, frame: int, state: SavedState) -> None:
        """Keep the state after a frame, in place of an earlier one."""
        self.drop(frame)
        self._states[frame] = state
        self._sizes[frame] = sum(array.nbytes for array in state.arrays.values())
        self._bytes += self._sizes[frame]
        while self._bytes > self._budget and self._stride <= frame:
            for each in [e for e in self._states if e < frame - RECENT and e % self._stride]:
                self._forget(each)
            if self._bytes > self._budget:
                self._stride *= 2

    def nearest(self, frame: int) -> tuple[int, SavedState] | None:
        """The latest state at or before the frame, with its frame; None where there is none."""
        before = [each for each in self._states if each <= frame]
        return (max(before), self._states[max(before)]) if before else None

    def drop_after(self, frame: int) -> None:
        """Forget the states of later frames."""
        for each in [each for each in self._states if each > frame]:
            self._forget(each)

    def drop(self, frame: int) -> None:
        """Forget the state of a frame, if there is one."""
        if frame in self._states:
            self._forget(frame)

    def __len__(self) -> int:
        return len(self._states)

    def _forget(self, frame: int) -> None:
        self._bytes -= self._sizes.pop(frame)
        del self._states[frame]
