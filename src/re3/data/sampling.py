"""Draws training clips from a mix of real tracks and simulated scenes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count

import numpy as np

from re3.data.augment import AugmentedClip, PhotometricConfig
from re3.data.clip import Clip, MirroredClip, RecordedClip
from re3.data.frame_store import FrameStore
from re3.data.sequence import Sequence
from re3.data.simulator import SimulationConfig, simulate
from re3.data.stills import Still
from re3.geometry import convert

TRIES = 20
"""Draws of a clip that leaps, before one that does not is taken instead."""


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


class ClipSampler:
    """Draws clips; the same generator gives the same clip.

    Args:
        sequences: real tracks; may be empty if there are stills.
        stills: pictures for simulation; may be empty if there are tracks.
        store: decoded frames of the tracks' videos.
        config: the mix.

    Raises:
        ValueError: there is nothing to draw from.
    """

    def __init__(
        self,
        sequences: list[Sequence],
        stills: list[Still],
        store: FrameStore,
        config: SamplingConfig | None = None,
    ) -> None:
        self.config = config or SamplingConfig()
        self.store = store
        self.stills = stills
        self.sequences = [s for s in sequences if self._usable(s)]
        if not self.sequences and not stills:
            raise ValueError(
                f"nothing to train on: of {len(sequences)} tracks none has a box of "
                f"{self.config.smallest} pixels or more in two frames, and there are no stills"
            )
        self._weights = _weights(self.sequences)

    def _usable(self, sequence: Sequence) -> bool:
        boxes = sequence.boxes_xywh[sequence.annotated]
        return (
            len(boxes) >= 2 and float(np.median(boxes[:, 2:].min(axis=1))) >= self.config.smallest
        )

    def sample(self, frames: int, rng: np.random.Generator) -> Clip:
        """A clip of so many frames with the object present in the first."""
        config = self.config
        share = config.simulated if self.sequences and self.stills else float(bool(self.stills))
        clip: Clip
        leaps = frames > 1 and rng.random() < config.leaps
        for attempt in count():
            leaps &= attempt < TRIES  # a track of a few frames has none to leap between
            if rng.random() < share:
                leap = _log_uniform(config.leap_simulated, rng) if leaps else 1
                clip = simulate(self.stills, frames, rng, config.simulation, leap)
            else:
                clip = self._recorded(frames, leaps, rng)
            if not np.isnan(clip.boxes_xyxy[: 1 + clip.leaps, 0]).any():
                break
        if rng.random() < config.mirrored:
            clip = MirroredClip(clip)
        return AugmentedClip(clip, rng, config.photometric)

    def _recorded(self, frames: int, leaps: bool, rng: np.random.Generator) -> RecordedClip:
        sequence = self.sequences[int(rng.choice(len(self.sequences), p=self._weights))]
        stride = int(rng.choice(self.config.strides))
        span = (frames - 1) * stride
        if span >= len(sequence):  # a short track is walked at the stride that fits
            stride = max(1, (len(sequence) - 1) // max(frames - 1, 1))
            span = (frames - 1) * stride
        first = rng.choice(np.flatnonzero(sequence.annotated))
        first = int(np.clip(first, 0, max(len(sequence) - 1 - span, 0)))
        indices = np.minimum(first + stride * np.arange(frames), len(sequence) - 1)
        if rng.random() < self.config.reversed:
            indices = indices[::-1]
        if leaps:
            leap = _log_uniform(self.config.leap_frames, rng) * int(rng.choice([-1, 1]))
            indices = indices.copy()
            indices[0] = np.clip(indices[1] - leap, 0, len(sequence) - 1)
        video, scale = self.store.frames(sequence.source)
        boxes = convert(sequence.boxes_xywh[indices] * scale, "xywh", "xyxy")
        images = [video[min(sequence.start_frame + i, len(video) - 1)] for i in indices]
        return RecordedClip(images, boxes, self.config.fill, leaps)


def _log_uniform(limits: tuple[int, int], rng: np.random.Generator) -> int:
    return round(float(np.exp(rng.uniform(*np.log(limits)))))


def _weights(sequences: list[Sequence]) -> np.ndarray:
    """Probability of each track: datasets, and tracks within them, by the root of their length.

    The root keeps a dataset with many long but similar tracks from crowding out the others.
    """
    if not sequences:
        return np.zeros(0)
    totals: dict[str, float] = {}
    roots = np.sqrt([float(s.annotated.sum()) for s in sequences])
    lengths: dict[str, float] = {}
    for sequence, root in zip(sequences, roots, strict=True):
        totals[sequence.dataset] = totals.get(sequence.dataset, 0.0) + root
        lengths[sequence.dataset] = lengths.get(sequence.dataset, 0.0) + root**2
    weights = np.array(
        [
            root / totals[s.dataset] * np.sqrt(lengths[s.dataset])
            for s, root in zip(sequences, roots, strict=True)
        ]
    )
    return weights / weights.sum()
