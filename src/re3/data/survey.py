"""What training really sees: clips drawn as it draws them, measured without looking at pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from re3.data.augment import AugmentedClip
from re3.data.clip import Kind
from re3.data.sampling import ClipSampler
from re3.geometry import Floats, convert

HIDDEN = 0.5
"""An object that is hidden by this share or more counts as occluded, as benchmarks mark it."""


@dataclass(frozen=True, eq=False)
class ClipFacts:
    """What there is to say about a clip of T frames.

    Attributes:
        source, kind: where it comes from.
        sizes: `[T]`, root of the box's area in pixels of the frame; NaN where the object is absent.
        motion: `[T - 1]`, way of the centre to the next frame in units of the size; NaN where
            either is absent.
        growth: `[T - 1]`, size in the next frame by that in this one.
        hidden: `[T]`, share of the object that is hidden, 0..1, or whether the dataset marks it as
            occluded, 0 or 1; NaN where it is absent, or nothing is known.
    """

    source: str
    kind: Kind
    sizes: Floats
    motion: Floats
    growth: Floats
    hidden: Floats

    @property
    def absent(self) -> Floats:
        """`[T]`, 1 where the object is absent, else 0."""
        return np.isnan(self.sizes).astype(np.float64)


@dataclass(frozen=True)
class SourceFacts:
    """What was drawn from a source.

    Attributes:
        name, kind: of the source; a source with both kinds comes twice.
        clips: drawn from it.
        declared: share that it is to have, by its weight.
        drawn: share of the clips.
        size, motion, growth: 10th percentile, median and 90th of the sizes in pixels, of the motion
            and of the change of the size (0.1 is 10 %, whether larger or smaller); NaN without any.
        occluded: share of the frames with the object in which `HIDDEN` of it or more is hidden;
            NaN where nothing is known.
        absent: share of the frames without the object.
    """

    name: str
    kind: Kind
    clips: int
    declared: float
    drawn: float
    size: tuple[float, float, float]
    motion: tuple[float, float, float]
    growth: tuple[float, float, float]
    occluded: float
    absent: float


@dataclass(frozen=True, eq=False)
class Survey:
    """Clips that were drawn, and the shares that their sources were to have."""

    clips: tuple[ClipFacts, ...]
    declared: dict[tuple[str, Kind], float]

    def sources(self) -> list[SourceFacts]:
        """Every source, those that no clip was drawn from as well."""
        return [self._facts(name, kind) for name, kind in self.declared]

    def _facts(self, name: str, kind: Kind) -> SourceFacts:
        clips = [clip for clip in self.clips if (clip.source, clip.kind) == (name, kind)]
        hidden = joined([clip.hidden for clip in clips])
        return SourceFacts(
            name=name,
            kind=kind,
            clips=len(clips),
            declared=self.declared[name, kind],
            drawn=len(clips) / len(self.clips),
            size=_percentiles(joined([clip.sizes for clip in clips])),
            motion=_percentiles(joined([clip.motion for clip in clips])),
            growth=_percentiles(np.expm1(np.abs(np.log(joined([c.growth for c in clips]))))),
            occluded=float((hidden >= HIDDEN).mean()) if len(hidden) else np.nan,
            absent=float(np.concatenate([c.absent for c in clips]).mean()) if clips else np.nan,
        )


def survey(
    sampler: ClipSampler,
    clips: int,
    frames: int,
    seed: int = 0,
    on_progress: Callable[[int], None] | None = None,
) -> Survey:
    """Draw clips and measure them.

    Args:
        sampler: what training draws from.
        clips: how many, 1 or more.
        frames: T of each, 2 or more.
        seed: another seed, other clips.
        on_progress: called after each clip with the number done.

    Raises:
        ValueError: no clip, or too few frames; or what the sampler raises.
    """
    if clips < 1 or frames < 2:
        raise ValueError(
            f"{clips} clips of {frames} frames; expected 1 or more, of 2 frames or more"
        )
    facts = []
    for index, child in enumerate(np.random.SeedSequence(seed).spawn(clips), start=1):
        facts.append(clip_facts(sampler.sample(frames, np.random.default_rng(child))))
        if on_progress is not None:
            on_progress(index)
    return Survey(tuple(facts), sampler.shares())


def clip_facts(clip: AugmentedClip) -> ClipFacts:
    """Measure a clip that a sampler has drawn.

    Raises:
        ValueError: the clip does not say where it comes from.
    """
    if clip.origin is None:
        raise ValueError("a clip without origin; expected one that a ClipSampler has drawn")
    boxes = convert(clip.boxes_xyxy, "xyxy", "cxcywh")
    sizes = np.sqrt(boxes[:, 2] * boxes[:, 3])
    present = ~np.isnan(sizes)
    if clip.origin.kind == "stills":
        hidden = np.where(present, 1.0 - clip.visible, np.nan)
    elif clip.origin.occluded is not None:
        hidden = np.where(present, clip.origin.occluded, np.nan)
    else:
        hidden = np.full(len(boxes), np.nan)
    motion = np.hypot(*np.diff(boxes[:, :2], axis=0).T) / sizes[:-1]
    growth = sizes[1:] / sizes[:-1]
    if clip.leaps:  # the first two frames do not follow each other
        motion[0] = growth[0] = np.nan
    return ClipFacts(
        source=clip.origin.source,
        kind=clip.origin.kind,
        sizes=sizes,
        motion=motion,
        growth=growth,
        hidden=hidden,
    )


def joined(values: list[Floats]) -> Floats:
    """All values of some clips that are not NaN."""
    whole = np.concatenate(values) if values else np.zeros(0)
    return whole[~np.isnan(whole)]


def _percentiles(values: Floats) -> tuple[float, float, float]:
    if not len(values):
        return (np.nan, np.nan, np.nan)
    low, middle, high = (float(value) for value in np.percentile(values, (10, 50, 90)))
    return (low, middle, high)
