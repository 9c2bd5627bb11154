"""How strongly, and how often, the looks of training clips are changed."""

from __future__ import annotations

from dataclasses import dataclass

from re3.data.checks import check_at_least_zero, check_probabilities


@dataclass(frozen=True)
class PhotometricConfig:
    """Strengths and probabilities; a probability is per clip unless it says per frame.

    Attributes:
        gain, offset: standard deviation of log contrast and of brightness (0..255).
        tint: standard deviation of the log gain of each colour channel.
        waver: share of those deviations that changes from frame to frame.
        weather: standard deviation of log contrast by which the first frame of a clip that leaps
            differs from the others.
        grey: probability of a clip without colour.
        blur: probability of a soft clip.
        motion_blur: probability per frame of a blur in a random direction.
        noise: probability of sensor noise.
        jpeg: probability of compression.
    """

    gain: float = 0.2
    offset: float = 12.0
    tint: float = 0.06
    waver: float = 0.15
    weather: float = 0.15
    grey: float = 0.08
    blur: float = 0.15
    motion_blur: float = 0.08
    noise: float = 0.15
    jpeg: float = 0.15

    def __post_init__(self) -> None:
        check_at_least_zero(self, ("gain", "offset", "tint", "waver", "weather"))
        check_probabilities(self, ("grey", "blur", "motion_blur", "noise", "jpeg"))


NO_EFFECTS = PhotometricConfig(
    gain=0, offset=0, tint=0, waver=0, weather=0, grey=0, blur=0, motion_blur=0, noise=0, jpeg=0
)
"""Crops as they are."""
