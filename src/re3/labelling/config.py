"""What labelling keeps."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LabelConfig:
    """What is kept of a video.

    Attributes:
        threshold: least overlap (IoU) of any two of the three boxes, 0..1.
        shortest: frames of a track at least.
        longest: frames of a track at most.
        gap: frames in a row without agreement that a track may contain; their boxes
            are interpolated.
        fps: frames a second; a video with more is thinned out.
        side: longer side of the frames in pixels at most.
        objects: objects of a shot at most.
        least_side: of the box in pixels.
        least_motion: how far a box must travel, in units of its size.

    Raises:
        ValueError: a value out of its range.
    """

    threshold: float = 0.6
    shortest: int = 24
    longest: int = 100
    gap: int = 3
    fps: float = 15.0
    side: int = 360
    objects: int = 3
    least_side: float = 8.0
    least_motion: float = 0.2

    def __post_init__(self) -> None:
        if not 0 < self.threshold <= 1:
            raise ValueError(f"threshold is {self.threshold}; expected an overlap above 0, up to 1")
        if not 2 <= self.shortest <= self.longest:
            raise ValueError(
                f"shortest is {self.shortest} and longest {self.longest}; expected 2 frames or "
                "more, and longest not below shortest"
            )
        for name, least in (("gap", 0), ("objects", 1), ("side", 32)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}; expected {least} or more")
        if not self.fps > 0:
            raise ValueError(f"fps is {self.fps}; expected above 0")
