"""Boxes about something else than the dataset's: a part of the object, or it and more.

A dataset's boxes are all drawn by one rule, about whole objects as a rule, and users draw what they
like: a face, half a person, a generous rectangle. A framing says where such a box lies in the
dataset's, or about it, and keeps it there through the clip. That is exact for what moves as a
whole, and about right for what bends or turns.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from re3.data.sequence import Sequence
from re3.geometry import Floats, convert


@dataclass(frozen=True)
class Framing:
    """Where a box lies relative to another.

    Attributes:
        shift: x and y from one centre to the other, in widths and heights of the other box.
        scale: its width and height, in those of the other box.
    """

    shift: tuple[float, float]
    scale: tuple[float, float]

    def of(self, boxes_xyxy: ArrayLike) -> Floats:
        """The boxes `[..., 4]` so framed, in the units of those given; NaN where those are."""
        boxes = convert(boxes_xyxy, "xyxy", "cxcywh")
        sides = boxes[..., 2:]
        framed = np.concatenate([boxes[..., :2] + sides * self.shift, sides * self.scale], axis=-1)
        return convert(framed, "cxcywh", "xyxy")


FRAMINGS = {
    "inner": Framing((0.0, 0.0), (0.7, 0.7)),
    "outer": Framing((0.0, 0.0), (1.3, 1.3)),
    "upper": Framing((0.0, -0.25), (1.0, 0.5)),
    "left": Framing((-0.2, 0.0), (0.6, 1.0)),
    "wide": Framing((0.0, 0.0), (1.4, 0.8)),
    "tall": Framing((0.0, 0.0), (0.7, 1.2)),
}
"""Name -> the framings that trackers are tried with (protocol `framed`)."""


def frame_otherwise(sequences: Iterable[Sequence]) -> list[Sequence]:
    """Each sequence with its boxes in each of `FRAMINGS`, without polygons."""
    given = list(sequences)
    return [
        replace(
            sequence,
            boxes_xywh=convert(
                framing.of(convert(sequence.boxes_xywh, "xywh", "xyxy")), "xyxy", "xywh"
            ),
            dataset=f"{sequence.dataset}-framed-{name}",
            polygons=None,
        )
        for name, framing in FRAMINGS.items()
        for sequence in given
    ]
