"""The saved state of a tracker, split by object and joined again.

`re3.MultiTracker.save_state` saves all objects at one frame. Objects do not influence each other,
so the part of one object can be loaded alone, or together with parts of other objects that were
saved at the same frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

ObjectState = dict[str, NDArray]
"""Arrays by name: those of the object under `object/`, those of the tracker without a prefix."""

_OWN = "object/"
_COUNTERS = ("ids", "next_id")


def split_state(saved: Mapping[str, NDArray]) -> dict[int, ObjectState]:
    """The state of every object.

    Args:
        saved: as `MultiTracker.save_state` returns it.

    Returns:
        tracker's id of the object -> its state; arrays are shared with `saved`, not copied.
    """
    common = {n: v for n, v in saved.items() if "/" not in n and n not in _COUNTERS}
    return {identity: _state_of(saved, identity) | common for identity in map(int, saved["ids"])}


def join_states(states: Sequence[ObjectState]) -> dict[str, NDArray]:
    """One state for `MultiTracker.load_state`, in which the objects have the ids 1, 2, 3 ...

    Args:
        states: at least one; all saved at the same frame and by the same model.
    """
    joined = {name: v for name, v in states[0].items() if not name.startswith(_OWN)}
    for identity, state in enumerate(states, start=1):
        own = {name: value for name, value in state.items() if name.startswith(_OWN)}
        joined |= {f"{identity}/{name.removeprefix(_OWN)}": value for name, value in own.items()}
    count = len(states)
    return joined | {"ids": np.arange(1, count + 1), "next_id": np.array(count + 1)}


def _state_of(saved: Mapping[str, NDArray], identity: int) -> ObjectState:
    prefix = f"{identity}/"
    own = {name: value for name, value in saved.items() if name.startswith(prefix)}
    return {_OWN + name.removeprefix(prefix): value for name, value in own.items()}
