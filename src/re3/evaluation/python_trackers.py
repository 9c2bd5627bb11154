"""Trackers that are any Python object with `init` and `update`, by the name of their class."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class PythonTracker:
    """Such an object behind the protocol of `re3.evaluation.peers.SequenceTracker`.

    Its `init(frame, box_xywh)` is called once and `update(frame)` for every frame after. `update`
    gives a box and a score, a box alone, or an object with `box_xywh` and `score` such as
    `re3.Result`.

    Args:
        spec: `package.module:Class`; the class, or function, is called without arguments.
    """

    def __init__(self, spec: str) -> None:
        self._tracker = find_class(spec)()

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start at a box."""
        self._tracker.init(frame, tuple(float(value) for value in np.asarray(box_xywh)))

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The box and the score; 1 where the object gives none."""
        given = self._tracker.update(frame)
        if hasattr(given, "box_xywh"):
            return given.box_xywh, getattr(given, "score", 1.0)
        if len(given) == 2:
            box, score = given
            return box, score
        return given, 1.0

    def close(self) -> None:
        """Close the object, where it can be."""
        if hasattr(self._tracker, "close"):
            self._tracker.close()


def find_class(spec: str) -> Callable[[], Any]:
    """The class `package.module:Class` names; modules in the working folder are found too.

    Raises:
        ValueError: it is not of that form, cannot be imported, or has no `init` and `update`.
    """
    module_name, colon, name = spec.partition(":")
    if not colon or not module_name or not name.isidentifier():
        raise ValueError(f"{spec!r} does not name a class; expected package.module:Class")
    here = str(Path.cwd())
    if here not in sys.path:
        # Last, so that nothing installed is hidden by a file that happens to lie here.
        sys.path.append(here)
    try:
        found = getattr(importlib.import_module(module_name), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(
            f"{spec!r} cannot be imported ({error}); expected package.module:Class of an "
            "installed package, of PYTHONPATH or of the working folder"
        ) from error
    if isinstance(found, type) and not (hasattr(found, "init") and hasattr(found, "update")):
        raise ValueError(
            f"{spec!r} has no methods init and update; expected a tracker with "
            "init(frame, box_xywh) and update(frame)"
        )
    return found
