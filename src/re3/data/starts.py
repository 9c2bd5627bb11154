"""Other starts of a clip: in later frames, and from boxes drawn less carefully than the dataset's.

One start of each of a few clips says little of a tracker: single moments decide. Both ways to start
are those of Wu, Lim, Yang: Online object tracking: a benchmark, CVPR 2013, with the numbers of its
toolkit, which rounds boxes to pixels.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from re3.data.framing import Framing
from re3.data.sequence import Sequence
from re3.geometry import convert

STARTS = 20
"""Frames of a clip that a tracker is started in."""

LEAST_FRAMES = 20
"""Frames from the last start to the end, at least."""

SAMPLED_STARTS = 6
"""Of `sample_starts`: later starts of a clip, and shifted ones."""

SAMPLED_FRAMES = 120
"""Of `sample_starts`: frames of a track, at most."""

_SHIFTS = (-0.1, 0.0, 0.1)
_SCALES = (0.8, 0.9, 1.1, 1.2)

SHIFTED_STARTS = (
    *(Framing((x, y), (1.0, 1.0)) for x in _SHIFTS for y in _SHIFTS if x or y),
    *(Framing((0.0, 0.0), (scale, scale)) for scale in _SCALES),
)
"""Boxes to start from: the true one moved by a tenth of its sides in eight directions, and four
sizes of it."""


_SAMPLED_SHIFTS = (1, 3, 6, 8, 9, 12)
"""Numbers in `SHIFTED_STARTS`, from 1: the four diagonal shifts, and the smallest and the
largest box."""


@dataclass(frozen=True, eq=False)
class ShiftedSequence(Sequence):
    """A sequence that trackers are started in beside the true box.

    Attributes:
        start: where the box to start from lies relative to the true one.
    """

    start: Framing = field(default=Framing((0.0, 0.0), (1.0, 1.0)))

    @property
    def start_xywh(self) -> NDArray[np.float64]:
        """`[4]`, the box that a tracker is given, which is not the true one."""
        return convert(self.start.of(convert(super().start_xywh, "xywh", "xyxy")), "xyxy", "xywh")


def start_later(sequences: Iterable[Sequence]) -> list[Sequence]:
    """What is left of each sequence from each of up to `STARTS` frames on.

    A start is annotated, not marked as occluded, and has `LEAST_FRAMES` frames or more to the end;
    a sequence without such a frame starts once, where it is first annotated. Sequences are named
    after clip and frame, `blackswan/from-12`, counted from the start of the track.
    """
    return [
        replace(
            sequence,
            name=f"{sequence.name}/from-{first}",
            dataset=f"{sequence.dataset}-tre",
            start_frame=sequence.start_frame + first,
            boxes_xywh=sequence.boxes_xywh[first:],
            occluded=None if sequence.occluded is None else sequence.occluded[first:],
            polygons=None if sequence.polygons is None else sequence.polygons[first:],
        )
        for sequence in sequences
        for first in _starts(sequence)
    ]


def _starts(sequence: Sequence) -> list[int]:
    usable = sequence.annotated.copy()
    if sequence.occluded is not None:
        usable &= ~sequence.occluded
    (frames,) = np.nonzero(usable[: max(len(sequence) - LEAST_FRAMES + 1, 0)])
    if not len(frames):
        return [int(np.argmax(sequence.annotated))]
    places = np.arange(STARTS - 1) * len(frames) // (STARTS - 1)
    return sorted({*frames[places].tolist(), int(frames[-1])})


def start_shifted(sequences: Iterable[Sequence]) -> list[Sequence]:
    """Each sequence from each of `SHIFTED_STARTS`, compared with the truth as it is.

    They are named after clip and start, counted from 1: `blackswan/shifted-3`.
    """
    made: list[Sequence] = []
    for sequence in sequences:
        values = {part.name: getattr(sequence, part.name) for part in fields(Sequence)}
        values["dataset"] = f"{sequence.dataset}-sre"
        for number, start in enumerate(SHIFTED_STARTS, start=1):
            values["name"] = f"{sequence.name}/shifted-{number}"
            made.append(ShiftedSequence(**values, start=start))
    return made


def sample_starts(sequences: Iterable[Sequence]) -> list[Sequence]:
    """A fixed subset of the sequences of `start_later` and `start_shifted`, as one dataset.

    Of each clip it has `SAMPLED_STARTS` evenly spaced later starts, fewer of a short clip, and as
    many shifted ones, each cut after `SAMPLED_FRAMES` frames. The dataset is named after those of
    the clips, `davis+segtrack-starts`, the sequences after dataset, clip and start,
    `davis/blackswan/from-12`.
    """
    clips = list(sequences)
    name = "+".join(dict.fromkeys(clip.dataset for clip in clips))
    made = []
    for clip in clips:
        later = start_later([clip])
        chosen = np.linspace(0, len(later) - 1, min(SAMPLED_STARTS, len(later))).round().astype(int)
        shifted = start_shifted([clip])
        made += [later[index] for index in chosen]
        made += [shifted[number - 1] for number in _SAMPLED_SHIFTS]
    return [
        replace(
            _first_frames(sequence, SAMPLED_FRAMES),
            name=f"{sequence.dataset.rpartition('-')[0]}/{sequence.name}",
            dataset=f"{name}-starts",
        )
        for sequence in made
    ]


def _first_frames(sequence: Sequence, frames: int) -> Sequence:
    """A sequence up to so many frames after its first annotated one, with that."""
    end = int(np.argmax(sequence.annotated)) + frames
    return replace(
        sequence,
        boxes_xywh=sequence.boxes_xywh[:end],
        occluded=None if sequence.occluded is None else sequence.occluded[:end],
        polygons=None if sequence.polygons is None else sequence.polygons[:end],
    )
