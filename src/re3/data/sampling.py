"""Draws training clips from a mix of real tracks and simulated scenes."""

from __future__ import annotations

import copy
from collections.abc import Sequence as Several
from dataclasses import dataclass, field, replace
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from re3.data.augment import AugmentedClip
from re3.data.clip import Clip, Kind, MirroredClip, Origin, RecordedClip
from re3.data.frame_store import FrameStore
from re3.data.sampling_config import SamplingConfig
from re3.data.scene import Scene
from re3.data.sequence import Sequence
from re3.data.simulator import simulate
from re3.data.stills import Still
from re3.geometry import Floats, convert

MOST_SCENES = 100
"""Scenes drawn before it is given up that the object is there in the first frame."""

TRIES = 20
"""Draws of a clip that leaps, before one that does not is taken instead."""


@dataclass(frozen=True, eq=False)
class Source:
    """Tracks or stills that are drawn from with a weight of their own.

    Attributes:
        name: of the source; empty where each clip goes by the name of its dataset.
        sequences: real tracks.
        stills: pictures for simulation.
        weight: share of the clips among the sources of the same kind, in any unit; above 0.
    """

    name: str
    sequences: Several[Sequence] = ()
    stills: Several[Still] = ()
    weight: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.weight < np.inf:
            raise ValueError(f"source {self.name!r} has weight {self.weight}; expected above 0")


class ClipSampler:
    """Draws clips; the same generator gives the same clip.

    Args:
        sequences: real tracks; may be empty if there are stills.
        stills: pictures for simulation; may be empty if there are tracks.
        store: decoded frames of the tracks' videos.
        config: the mix.

    Attributes:
        sequences, stills: what is drawn from, of all sources.

    Raises:
        ValueError: there is nothing to draw from.
    """

    def __init__(
        self,
        sequences: Several[Sequence],
        stills: Several[Still],
        store: FrameStore,
        config: SamplingConfig | None = None,
    ) -> None:
        self._set_up([Source("", sequences, stills)], store, config)

    @classmethod
    def of(
        cls, sources: Several[Source], store: FrameStore, config: SamplingConfig | None = None
    ) -> ClipSampler:
        """A sampler of weighted sources.

        The share of a source with tracks is its weight among those, times the share of clips that
        are not simulated; that of one with stills likewise.

        Raises:
            ValueError: there is nothing to draw from, in all or in one of the sources.
        """
        sampler = cls.__new__(cls)
        sampler._set_up(sources, store, config)
        return sampler

    def with_fill(self, fill: tuple[float, float, float]) -> ClipSampler:
        """A sampler of the same sources with this BGR colour outside frames and scenes."""
        other = copy.copy(self)
        other.config = self.config.with_fill(fill)
        return other

    def _set_up(
        self, sources: Several[Source], store: FrameStore, config: SamplingConfig | None
    ) -> None:
        self.config = config or SamplingConfig()
        self.store = store
        self._tracks: list[_Tracks] = []
        self._stills: list[Source] = []
        for source in sources:
            usable = [s for s in source.sequences if self._usable(s)]
            if usable:
                self._tracks.append(_Tracks(source, usable))
            if source.stills:
                self._stills.append(source)
            if not usable and not source.stills:
                name = f"source {source.name!r}: " if source.name else ""
                raise ValueError(
                    f"{name}nothing to train on: of {len(source.sequences)} tracks none has a box "
                    f"of {self.config.smallest} pixels or more in two frames, and there are no "
                    "stills"
                )
        self.sequences = [s for tracks in self._tracks for s in tracks.sequences]
        self.stills = [still for source in self._stills for still in source.stills]
        if not self.sequences and not self.stills:
            raise ValueError("nothing to train on: no source has tracks or stills")

    def _usable(self, sequence: Sequence) -> bool:
        boxes = sequence.boxes_xywh[sequence.annotated]
        return (
            len(boxes) >= 2 and float(np.median(boxes[:, 2:].min(axis=1))) >= self.config.smallest
        )

    @property
    def simulated(self) -> float:
        """Share of simulated clips."""
        if self._tracks and self._stills:
            return self.config.simulated
        return float(bool(self._stills))

    def shares(self) -> dict[tuple[str, Kind], float]:
        """Share of the clips by name and kind of the source, or of the dataset if it has none."""
        shares: dict[tuple[str, Kind], float] = {}

        def add(name: str, kind: Kind, share: float) -> None:
            shares[name, kind] = shares.get((name, kind), 0.0) + float(share)

        recorded = 1.0 - self.simulated
        for tracks, share in zip(self._tracks, _normalised(self._tracks), strict=True):
            for sequence, weight in zip(tracks.sequences, tracks.weights, strict=True):
                add(tracks.source.name or sequence.dataset, "videos", recorded * share * weight)
        for source, share in zip(self._stills, _normalised(self._stills), strict=True):
            for still in source.stills:
                name = source.name or still.dataset
                add(name, "stills", self.simulated * share / len(source.stills))
        return shares

    def sample(self, frames: int, rng: np.random.Generator) -> AugmentedClip:
        """A clip of so many frames with the object present in the first; `origin` says whence.

        Raises:
            ValueError, OSError: a picture or a video cannot be read.
        """
        config = self.config
        clip: Clip
        leaps = frames > 1 and rng.random() < config.leaps
        # The source is drawn once: were it drawn again with a clip that starts without the object,
        # sources with many such clips would come less often than their weight says.
        if rng.random() < self.simulated:
            clip, origin = self._simulated(frames, leaps, rng)
        else:
            tracks = self._tracks[_pick(self._tracks, rng)]
            clip, origin = self._seen(tracks, frames, leaps, rng)
        if rng.random() < config.mirrored:
            clip, origin = MirroredClip(clip), replace(origin, mirrored=True)
        return AugmentedClip(clip, rng, config.photometric, origin)

    def _simulated(
        self, frames: int, leaps: bool, rng: np.random.Generator
    ) -> tuple[Scene, Origin]:
        source = self._stills[_pick(self._stills, rng)]
        for attempt in range(MOST_SCENES):
            leaps &= attempt < TRIES
            leap = _log_uniform(self.config.leap_simulated, rng) if leaps else 1
            scene = simulate(source.stills, frames, rng, self.config.simulation, leap)
            if not np.isnan(scene.boxes_xyxy[: 1 + scene.leaps, 0]).any():
                break
        else:
            raise ValueError(
                f"{MOST_SCENES} simulated scenes began without their object; expected "
                "settings of the simulation that leave it in sight, such as more room"
            )
        assert scene.still is not None, "simulate says what it cut the object from"
        return scene, Origin(source.name or scene.still.dataset, "stills", scene.still.image.stem)

    def _seen(
        self, tracks: _Tracks, frames: int, leaps: bool, rng: np.random.Generator
    ) -> tuple[RecordedClip, Origin]:
        """A recorded clip that begins with the object, on both sides of its leap if it has one."""
        for _ in range(TRIES * leaps):
            clip, origin = self._recorded_of(tracks, frames, True, rng)
            if not np.isnan(clip.boxes_xyxy[:2, 0]).any():
                return clip, origin
        return self._recorded_of(tracks, frames, False, rng)

    def _recorded(self, frames: int, leaps: bool, rng: np.random.Generator) -> RecordedClip:
        return self._recorded_of(self._tracks[0], frames, leaps, rng)[0]

    def _recorded_of(
        self, tracks: _Tracks, frames: int, leaps: bool, rng: np.random.Generator
    ) -> tuple[RecordedClip, Origin]:
        sequence = tracks.sequences[int(rng.choice(len(tracks.sequences), p=tracks.weights))]
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
        if not leaps:
            indices = _begun_with_the_object(indices, sequence.annotated)
        else:
            leap = _log_uniform(self.config.leap_frames, rng) * int(rng.choice([-1, 1]))
            indices = indices.copy()
            indices[0] = np.clip(indices[1] - leap, 0, len(sequence) - 1)
        boxes = sequence.boxes_xywh[indices] * self.store.scale(sequence.source)
        in_video = sequence.start_frame + indices
        images = _Window(self.store, sequence, in_video)
        clip = RecordedClip(images, convert(boxes, "xywh", "xyxy"), self.config.fill, leaps)
        marks = sequence.occluded
        return clip, Origin(
            tracks.source.name or sequence.dataset,
            "videos",
            sequence.name,
            in_video,
            occluded=None if marks is None else marks[indices],
        )


class _Window:
    """The frames of a clip, read when the first of them is looked at."""

    def __init__(self, store: FrameStore, sequence: Sequence, indices: NDArray[np.int64]) -> None:
        self._store, self._source, self._indices = store, sequence.source, indices
        self._lock = Lock()
        self._images: list[NDArray[np.uint8]] | None = None

    def __getitem__(self, index: int, /) -> NDArray[np.uint8]:
        with self._lock:
            if self._images is None:
                self._images = self._store.read(self._source, self._indices)
            return self._images[index]


@dataclass(eq=False)
class _Tracks:
    """A source's usable tracks, and the probability of each."""

    source: Source
    sequences: list[Sequence]
    weights: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.weights = _weights(self.sequences)

    @property
    def weight(self) -> float:
        return self.source.weight


def _normalised(sources: Several[Source] | Several[_Tracks]) -> Floats:
    weights = np.array([source.weight for source in sources], dtype=np.float64)
    return weights / weights.sum() if len(weights) else weights


def _pick(sources: Several[Source] | Several[_Tracks], rng: np.random.Generator) -> int:
    # A single source draws no number: clips of such a sampler stay what they were.
    return int(rng.choice(len(sources), p=_normalised(sources))) if len(sources) > 1 else 0


def _begun_with_the_object(
    indices: NDArray[np.int64], annotated: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """The window moved to the nearest place where its first frame has a box."""
    if annotated[indices[0]]:
        return indices
    known = np.flatnonzero(annotated)
    start = known[np.argmin(np.abs(known - indices[0]))]
    return np.clip(indices + (start - indices[0]), 0, len(annotated) - 1)


def _log_uniform(limits: tuple[int, int], rng: np.random.Generator) -> int:
    return round(float(np.exp(rng.uniform(*np.log(limits)))))


def _weights(sequences: list[Sequence]) -> Floats:
    """Probability of each track: datasets, and tracks within them, by the root of their length.

    The root keeps a dataset with many long but similar tracks from crowding out the others.
    """
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
    normalised: Floats = weights / weights.sum()
    return normalised
