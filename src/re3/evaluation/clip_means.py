"""Figures with a standard error: the mean over clips, each clip being the mean over its tracks.

Tracks of the same clip are not independent of each other; clips are. So the error of a figure, and
that of the difference of two trackers, is computed over clips.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class MeanWithError:
    """A mean and how far it may be off.

    Attributes:
        mean: of the values; NaN without any.
        error: its standard error, the values' standard deviation (n - 1) over the root of n; NaN
            with fewer than two.
        count: n.
    """

    mean: float
    error: float
    count: int

    @classmethod
    def of(cls, values: ArrayLike) -> MeanWithError:
        """Of values `[N]`; NaN among them are left out."""
        known = np.asarray(values, dtype=np.float64)
        known = known[~np.isnan(known)]
        count = len(known)
        mean = float(known.mean()) if count else math.nan
        error = float(known.std(ddof=1) / math.sqrt(count)) if count > 1 else math.nan
        return cls(mean, error, count)


def clip_means(values: Iterable[tuple[str, float]]) -> dict[str, float]:
    """The mean of each clip, in order of appearance; of one without any value NaN.

    Args:
        values: name of a clip and the value of one of its tracks; NaN are left out.
    """
    groups: dict[str, list[float]] = {}
    for clip, value in values:
        groups.setdefault(clip, []).append(value)
    return {clip: MeanWithError.of(group).mean for clip, group in groups.items()}
