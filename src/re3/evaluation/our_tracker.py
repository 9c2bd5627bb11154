"""`re3.Tracker` as a tracker to be evaluated, with what can be changed about it by name.

It also tells how long crops and network took, see `re3.timed_tracker`.

Options follow a model's name or file, each after an `@`: `re3-lite@torch`, `re3-lite@no-reset`,
`model.onnx@reset-16@threads-1`.
"""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.engine import ENGINES, load_engine
from re3.timed_tracker import TimedMultiTracker, TimeSpent

_WITH_OPTIONS = re.compile(r"(?P<model>.+?)(?P<options>(?:@[a-z0-9-]+)*)")
EXPECTED_OPTIONS = (
    "onnx-int8, onnx, openvino, torch, no-reset, reset-N, no-search, no-motion, framing, "
    "no-framing, mirror, no-mirror, threads-N"
)


@dataclass(frozen=True)
class OurOptions:
    """What differs from `re3.Tracker(model)`.

    Attributes:
        engine: as `re3.Tracker` takes it.
        threads: of the engine; 0 takes one fewer than there are cores, 4 at most.
        reset_interval: steps after which the recurrent state is reset (Re3, sec. III-C: 32); 0
            never; None as the model says.
        search: look for a lost object in a wider area.
        mirror: look at every crop mirrored as well; None as the model says.
        motion: look for an object where it is expected by its and the camera's motion.
        framing: keep to the box that was drawn where the network would draw it differently; None
            as `re3.Tracker` does.
    """

    engine: str = "auto"
    threads: int = 0
    reset_interval: int | None = None
    search: bool = True
    mirror: bool | None = None
    motion: bool = True
    framing: bool | None = None


def split_options(asked: str) -> tuple[str, OurOptions]:
    """A model's name or file, and the options after it.

    Raises:
        ValueError: an unknown option.
    """
    match = _WITH_OPTIONS.fullmatch(asked)
    if match is None:
        return asked, OurOptions()
    options = OurOptions()
    for word in match["options"].split("@")[1:]:
        name, _, number = word.rpartition("-")
        if word in ENGINES:
            options = replace(options, engine=word)
        elif word == "no-reset":
            options = replace(options, reset_interval=0)
        elif word == "no-search":
            options = replace(options, search=False)
        elif word == "no-motion":
            options = replace(options, motion=False)
        elif word in ("framing", "no-framing"):
            options = replace(options, framing=word == "framing")
        elif word in ("mirror", "no-mirror"):
            options = replace(options, mirror=word == "mirror")
        elif name == "reset" and number.isdecimal() and int(number) > 0:
            options = replace(options, reset_interval=int(number))
        elif name == "threads" and number.isdecimal() and int(number) > 0:
            options = replace(options, threads=int(number))
        else:
            raise ValueError(
                f"unknown option {word!r} in {asked!r}; expected one of {EXPECTED_OPTIONS}"
            )
    return match["model"], options


class OurTracker:
    """`re3.Tracker` with a shipped model or a model file.

    Args:
        model: name of a model or path of a model file, as `re3.Tracker` takes it.
        options: what is to be different.
    """

    def __init__(self, model: str, options: OurOptions | None = None) -> None:
        options = options or OurOptions()
        engine = load_engine(model, options.engine, options.threads, mirror=options.mirror)
        if options.reset_interval is not None:
            engine = copy.copy(engine)
            engine.spec = replace(engine.spec, reset_interval=options.reset_interval)
        self._tracker = TimedMultiTracker(
            model,
            engine,
            search=options.search,
            motion=options.motion,
            framing=options.framing,
        )

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start at a box, forgetting any earlier one, as `re3.Tracker.init` does."""
        identity = self._tracker.add(frame, box_xywh)
        for other in set(self._tracker.results) - {identity}:
            self._tracker.remove(other)

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The box and its score."""
        (result,) = self._tracker.update(frame).values()
        return result.box_xywh, result.score

    @property
    def time_spent(self) -> TimeSpent:
        """Where the time of the latest `init` or `update` went."""
        return self._tracker.time_spent
