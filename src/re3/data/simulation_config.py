"""What scenes the simulator draws."""

from __future__ import annotations

from dataclasses import dataclass

from re3.data.checks import (
    check_at_least_zero,
    check_colour,
    check_probabilities,
    check_ranges,
)

WAYS = ("walks", "camera", "behind")
"""How an object leaves: out of the scene, by a turn of the camera, or behind something."""


@dataclass(frozen=True)
class SimulationConfig:
    """What scenes are drawn. Lengths are in units of the object's size unless in pixels.

    Attributes:
        object_pixels: range of the object's size (root of its area) in pixels of the scene.
        room: range of the least width and height of the scene.
        speed: range, log-uniform, of the standard deviation of a clip's speed, per frame.
        turning: share of that speed by which the velocity changes each frame.
        scaling, stretching: standard deviation per frame of log scale and log aspect ratio.
        spinning: standard deviation per frame of the rotation, radians; masked objects only.
        bent: probability that a masked object changes its shape.
        bending: mean amplitude of those changes.
        camera: range, log-uniform, of the camera's speed, per frame.
        occluders: mean number of occluders for a clip of 8 frames or more; half for shorter ones.
        other_occluders: probability that an occluder is an object of any picture; else it is a
            random patch of the object's own, as in the paper.
        twin: probability of a copy of the object moving beside it.
        other: probability of another object in the scene.
        crossing: probability that a copy or another object crosses the object's path, behind it,
            in place of moving along; only where clips are drawn from packed data.
        foreign: probability of a background from another picture.
        leaves: probability that the object goes out of sight, in half of the cases for good, in a
            clip of more than 8 frames; half for those of 5 to 8, none for shorter ones. The
            background of such a clip is from another picture.
        leaves_by: how, each as often: it "walks" out of the scene, the "camera" turns away, or it
            goes "behind" something.
        fill: BGR colour outside the scene.
    """

    object_pixels: tuple[float, float] = (14.0, 200.0)
    room: tuple[float, float] = (2.0, 7.0)
    speed: tuple[float, float] = (0.005, 0.35)
    turning: float = 0.35
    scaling: float = 0.035
    stretching: float = 0.035
    spinning: float = 0.03
    bent: float = 0.6
    bending: float = 0.05
    camera: tuple[float, float] = (0.003, 0.2)
    occluders: float = 1.0
    other_occluders: float = 0.5
    twin: float = 0.15
    other: float = 0.25
    crossing: float = 0.0
    foreign: float = 0.3
    leaves: float = 0.0
    leaves_by: tuple[str, ...] = WAYS
    fill: tuple[float, float, float] = (127.0, 127.0, 127.0)

    def __post_init__(self) -> None:
        check_ranges(self, ("object_pixels", "room", "speed", "camera"))
        check_at_least_zero(
            self, ("turning", "scaling", "stretching", "spinning", "bending", "occluders")
        )
        check_probabilities(
            self,
            ("bent", "other_occluders", "twin", "other", "crossing", "foreign", "leaves"),
        )
        if not self.leaves_by or not set(self.leaves_by) <= set(WAYS):
            raise ValueError(
                f"leaves_by is {list(self.leaves_by)}; expected one or more of {', '.join(WAYS)}"
            )
        check_colour(self, "fill")


PAPER_SIMULATION = SimulationConfig(
    scaling=0.0,
    spinning=0.0,
    bent=0.0,
    camera=(0.003, 0.003),
    other_occluders=0.0,
    twin=0.0,
    other=0.0,
    foreign=0.0,
)
"""What the paper describes: object, background and occluders of one picture, rigid, that change in
speed, direction and aspect ratio. It gives no figures for those: they are ours, and so is the
camera, which here hardly moves."""
