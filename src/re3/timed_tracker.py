"""A tracker that tells where its time goes: in cutting crops, in the network, in the rest.

It finds the same boxes as `re3.MultiTracker`, which itself knows no clock. Looking at the clock
takes less than a microsecond a frame and object.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.engine import Engine, StepOutput
from re3.geometry import Floats
from re3.model_spec import CropSpec
from re3.models import DEFAULT_MODEL
from re3.result import Result
from re3.tracker import MultiTracker, TrackerOptions


class TimeSpent(NamedTuple):
    """Seconds of one call of a tracker; what is left of the call is state and decoding of boxes.

    Attributes:
        crop_seconds: cutting and warping crops.
        network_seconds: the step of the engine.
    """

    crop_seconds: float
    network_seconds: float


_NOT_TOLD = TimeSpent(float("nan"), float("nan"))


def time_spent(tracker: object) -> TimeSpent:
    """Where the time of a tracker's latest call went; NaN of one that does not tell.

    One that does has a property `time_spent`, as `TimedMultiTracker` has.
    """
    told = getattr(tracker, "time_spent", None)
    return told if isinstance(told, TimeSpent) else _NOT_TOLD


class TimedMultiTracker(MultiTracker):
    """`re3.MultiTracker` with a clock; see there for the arguments."""

    def __init__(
        self,
        model: str = DEFAULT_MODEL,
        engine: str | Engine = "auto",
        **options: Unpack[TrackerOptions],
    ) -> None:
        super().__init__(model, engine, **options)
        self._network = _TimedEngine(self._engine)
        self._engine = self._network
        self._crop_seconds = 0.0

    @property
    def time_spent(self) -> TimeSpent:
        """Of the latest `add` or `update`."""
        return TimeSpent(self._crop_seconds, self._network.seconds)

    def add(self, frame: NDArray[np.uint8], box_xywh: ArrayLike, name: str | None = None) -> int:
        """See `re3.MultiTracker.add`."""
        self._forget_times()
        return super().add(frame, box_xywh, name)

    def update(self, frame: NDArray[np.uint8]) -> dict[int, Result]:
        """See `re3.MultiTracker.update`."""
        self._forget_times()
        return super().update(frame)

    def _cut(
        self, image: NDArray[np.uint8], regions_xyxy: Floats, view: CropSpec
    ) -> NDArray[np.uint8]:
        started = time.perf_counter()
        crops = super()._cut(image, regions_xyxy, view)
        self._crop_seconds += time.perf_counter() - started
        return crops

    def _forget_times(self) -> None:
        self._crop_seconds = self._network.seconds = 0.0


class _TimedEngine:
    """An engine with a clock; `seconds` adds up its steps."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.spec = engine.spec
        self.seconds = 0.0

    def step(
        self,
        previous_crops: NDArray[np.uint8] | None,
        current_crops: NDArray[np.uint8],
        state: Mapping[str, NDArray[np.float32]],
    ) -> StepOutput:
        """See `re3.engine.base.Engine.step`."""
        started = time.perf_counter()
        output = self._engine.step(previous_crops, current_crops, state)
        self.seconds += time.perf_counter() - started
        return output
