"""How training clips are drawn from recorded tracks and simulated scenes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from re3.data.checks import check_colour, check_probabilities, check_ranges
from re3.data.photometric_config import NO_EFFECTS, PhotometricConfig
from re3.data.simulation_config import PAPER_SIMULATION, SimulationConfig


@dataclass(frozen=True)
class SamplingConfig:
    """The mix.

    Attributes:
        simulated: share of simulated clips, where there are both stills and tracks.
        mirrored: probability that a whole clip is mirrored (Re3, sec. III-C).
        reversed: probability that a recorded clip runs backwards.
        leaps: probability of a clip whose first frame was taken long before or after the others:
            objects are followed for much longer than a clip is, and look different by then.
        leap_frames, leap_simulated: range, log-uniform, of that time in frames, of recorded and
            of simulated clips.
        strides: steps between the frames of a recorded clip; one is drawn per clip.
        smallest: tracks whose box has a median side below this many pixels are left out.
        fill: BGR colour outside the frame.
    """

    simulated: float = 0.6
    mirrored: float = 0.5
    reversed: float = 0.5
    leaps: float = 0.6
    leap_frames: tuple[int, int] = (5, 250)
    leap_simulated: tuple[int, int] = (5, 60)
    strides: tuple[int, ...] = (1, 1, 1, 1, 2, 2, 3, 4, 6)
    smallest: float = 5.0
    fill: tuple[float, float, float] = (127.0, 127.0, 127.0)
    simulation: SimulationConfig = SimulationConfig()
    photometric: PhotometricConfig = PhotometricConfig()

    def __post_init__(self) -> None:
        check_probabilities(self, ("simulated", "leaps", "mirrored", "reversed"))
        check_ranges(self, ("leap_frames", "leap_simulated"))
        if not self.strides or min(self.strides) < 1:
            raise ValueError(
                f"strides is {list(self.strides)}; expected one or more whole numbers from 1 on"
            )
        if not self.smallest >= 0:
            raise ValueError(f"smallest is {self.smallest}; expected pixels, 0 or more")
        check_colour(self, "fill")

    def with_fill(self, fill: tuple[float, float, float]) -> SamplingConfig:
        """The same with this BGR colour outside frames and simulated scenes."""
        return replace(self, fill=fill, simulation=replace(self.simulation, fill=fill))


PAPER_SAMPLING = SamplingConfig(
    reversed=0.0,
    leaps=0.0,
    strides=(1,),
    simulation=PAPER_SIMULATION,
    photometric=NO_EFFECTS,
)
"""What the paper describes (sec. III-C): consecutive frames in their order, mirrored or not, no
change of colours, and its simulation."""
