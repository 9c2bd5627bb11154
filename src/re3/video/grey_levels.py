"""Pixels of 16 bits brought to 8, by one scale for all frames of a source."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Range = tuple[float, float]
"""Lowest and highest pixel value: they become 0 and 255."""

FULL = (0.0, 65535.0)
WIDE_SPAN = 32768
"""A first frame that spans at least this much is left with the full range of 16 bits."""

OUTLIERS = 1e-4
"""Share of pixels at each end that may be defect: they do not count for the range."""

DEEP_FORMATS = ("gray16le", "gray16be")
"""Pixel formats of FFmpeg that are brought to 8 bits here; swscale takes the upper 8 of them."""


@dataclass
class GreyLevels:
    """Scales pixels of 16 bits to 8, all by the range of the first image.

    Cameras of 12 or 14 bits and thermal cameras use a small part of 16 bits: the upper 8 bits alone
    would be one or two grey values.

    Attributes:
        given: the range to use in place of the first image's.
        note: what was done, for the user; None as long as nothing was scaled by a found range.
    """

    given: Range | None = None
    note: str | None = None
    _used: Range | None = field(default=None, init=False)

    @property
    def fixed(self) -> bool:
        """Whether the range is known."""
        return self._used is not None

    def scaled(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """The image in 8 bits; values outside the range become 0 or 255.

        Args:
            image: 16-bit integers, of any shape.
        """
        if self._used is None:
            self._used = self.given or self._found(image)
        low, high = self._used
        if self._used == FULL:
            return np.clip(image >> 8, 0, 255).astype(np.uint8)
        values = (image.astype(np.float32) - low) * (255.0 / (high - low))
        return np.clip(np.rint(values), 0, 255).astype(np.uint8)

    def _found(self, image: NDArray[Any]) -> Range:
        low, high = (
            float(v) for v in np.quantile(image, (OUTLIERS, 1 - OUTLIERS), method="nearest")
        )
        if low >= 0 and high - low >= WIDE_SPAN:
            return FULL
        if high == low:
            self.note = (
                f"16-bit pixels, all {low:.0f} in the first image: scaled from 0..65535; give the "
                "range of the others with --value-range LOW,HIGH"
            )
            return FULL
        self.note = (
            f"16-bit pixels scaled to 8 bits from {low:.0f}..{high:.0f}, the range of the first "
            "image; --value-range LOW,HIGH sets another"
        )
        return low, high
