"""Where the time of a frame goes: reading it, cutting crops, the network, the rest.

Only our tracker tells of its crops and its network; every other is a whole to the clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.evaluation.one_pass import Latency, Track, percentiles

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TimeParts:
    """Percentiles of the parts of a frame's time, in seconds; NaN where nothing was measured.

    All are over the frames with an update, starts left out, each part by itself: the medians of
    parts need not add up to the median of the whole.

    Attributes:
        decode: reading the frame.
        crop: cutting and warping crops.
        network: the engine's step.
        rest: what is left of the update: state, decoding and clipping boxes.
        update: the tracker as a whole, crop, network and rest.
        whole: decode and update.
    """

    decode: Latency
    crop: Latency
    network: Latency
    rest: Latency
    update: Latency
    whole: Latency

    @property
    def split(self) -> bool:
        """The tracker told of its crops and its network."""
        return bool(np.isfinite([self.crop.p50, self.network.p50]).all())


def time_parts(tracks: Iterable[Track]) -> TimeParts:
    """The parts over all tracks, of one tracker."""
    columns: dict[str, list[Floats]] = {"decode": [], "crop": [], "network": [], "update": []}
    for track in tracks:
        frames = track.update_frames
        columns["update"].append(track.seconds[frames])
        for name, part in (
            ("decode", track.decode_seconds),
            ("crop", track.crop_seconds),
            ("network", track.network_seconds),
        ):
            columns[name].append(np.full(len(frames), np.nan) if part is None else part[frames])
    seconds = {name: np.concatenate(each or [np.empty(0)]) for name, each in columns.items()}
    seconds["rest"] = seconds["update"] - seconds["crop"] - seconds["network"]
    seconds["whole"] = seconds["decode"] + seconds["update"]
    return TimeParts(**{name: percentiles(values) for name, values in seconds.items()})
