"""States of the tracker by segment and frame, to go on from any frame; bounded in memory."""

from __future__ import annotations

from collections.abc import Collection, Hashable

from re3.tracker_state import ObjectState

BUDGET = 96 << 20
"""Bytes; a state of one object in re3-lite takes 170 kB."""

RECENT = 24
"""Frames before the newest of a segment whose states are kept: stepping back is immediate."""

OWNERS = 16
"""Segments, those used last, of which states are kept when the budget is spent."""


class StateStore:
    """States by owner (a segment) and frame. Over the budget, older ones are thinned out evenly.

    Args:
        budget: in bytes.
    """

    def __init__(self, budget: int = BUDGET) -> None:
        self._budget = budget
        self._states: dict[Hashable, dict[int, ObjectState]] = {}  # owners: used last comes last
        self._bytes = 0
        self._stride = 1

    def put(self, owner: Hashable, frame: int, state: ObjectState) -> None:
        """Keep the state after a frame, in place of an earlier one."""
        states = self._states.pop(owner, {})
        self._states[owner] = states
        self._forget(states, frame)
        states[frame] = state
        self._bytes += _size(state)
        while self._bytes > self._budget and len(self._states) > OWNERS:
            self.drop(next(iter(self._states)))
        while self._bytes > self._budget:
            for each in self._states.values():
                newest = max(each, default=0)
                for at in [at for at in each if at < newest - RECENT and at % self._stride]:
                    self._forget(each, at)
            if self._bytes <= self._budget or self._stride > frame:
                break  # what is left are the recent ones
            self._stride *= 2

    def nearest(self, owner: Hashable, frame: int) -> tuple[int, ObjectState] | None:
        """The latest state at or before the frame, with its frame; None where there is none."""
        states = self._states.get(owner, {})
        at = max((each for each in states if each <= frame), default=None)
        return None if at is None else (at, states[at])

    def drop(self, owner: Hashable) -> None:
        """Forget all states of an owner, if there are any."""
        states = self._states.pop(owner, {})
        for frame in list(states):
            self._forget(states, frame)

    def keep_only(self, owners: Collection[Hashable]) -> None:
        """Forget the states of all others."""
        for owner in [each for each in self._states if each not in owners]:
            self.drop(owner)

    def __len__(self) -> int:
        return sum(map(len, self._states.values()))

    def _forget(self, states: dict[int, ObjectState], frame: int) -> None:
        if frame in states:
            self._bytes -= _size(states.pop(frame))


def _size(state: ObjectState) -> int:
    return sum(array.nbytes for array in state.values())
