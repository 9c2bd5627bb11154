"""Draws simulated scenes, many at once (Re3, sec. III-C); see `re3.data.simulator` for one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.data.leaving import chance_of_leaving
from re3.data.simulation_config import SimulationConfig
from re3.geometry import Floats
from re3.training.packed.clips import (
    ABSENT,
    BACKGROUND,
    BENDING_MODES,
    ELLIPSE,
    LAYERS,
    NUMBERED,
    OCCLUDERS,
    OTHER,
    RECTANGLE,
    TARGET,
    TWIN,
    WHOLE,
)
from re3.training.packed.departures import leave
from re3.training.packed.index import PackedIndex

STRONGEST_BEND = 0.12
"""Largest amplitude of a bending mode, in shares of the object's sides."""
STEEPEST_BEND = 0.3
"""Largest slope of a mode; where the slopes add up to 1 a picture would fold over."""
BEND_STEPS = 6
"""Iterations that find where a point of a bent picture is shown."""


@dataclass(eq=False)
class Scenes:
    """N scenes of T frames; arrays as in `ClipBatch`, `to_scene` the other way round.

    Attributes:
        boxes_xyxy: float64 `[T, N, 4]` of the targets, not cut at the border; NaN where absent.
        bend: amplitude, frequency and phase.
    """

    image: NDArray[np.int64]
    to_scene: Floats
    rectangle: Floats
    opaque: NDArray[np.int64]
    shown: NDArray[np.bool_]
    number: NDArray[np.int64]
    bend: tuple[Floats, Floats, Floats]
    size: Floats
    boxes_xyxy: Floats
    source: NDArray[np.int64]

    def replace(self, rows: NDArray[np.int64], others: Scenes) -> None:
        """Put other scenes in the place of some."""
        for name in ("image", "to_scene", "shown", "boxes_xyxy"):
            getattr(self, name)[:, rows] = getattr(others, name)
        for name in ("rectangle", "opaque", "number", "size", "source"):
            getattr(self, name)[rows] = getattr(others, name)
        self.bend[0][:, rows] = others.bend[0]
        self.bend[1][rows], self.bend[2][rows] = others.bend[1:]


@dataclass(frozen=True, eq=False)
class CutOuts:
    """N cut-outs: image `[N]`, rectangle `[N, 4]`, number and opaque `[N]`, still `[N]`."""

    image: NDArray[np.int64]
    rectangle: Floats
    number: NDArray[np.int64]
    opaque: NDArray[np.int64]
    still: NDArray[np.int64]
    row: NDArray[np.int64]

    @property
    def side(self) -> Floats:
        """Root of the area of each, in pixels of its picture."""
        size = self.rectangle[:, 2:] - self.rectangle[:, :2]
        side: Floats = np.sqrt(size.prod(axis=1))
        return side

    @property
    def masked(self) -> NDArray[np.bool_]:
        return self.opaque == NUMBERED


class SceneDrawer:
    """Draws scenes.

    Args:
        index: of the stills and their objects.
        config: what scenes are drawn.
    """

    def __init__(self, index: PackedIndex, config: SimulationConfig) -> None:
        self.index, self.config = index, config
        self._cumulative = np.cumsum(index.still_weights)

    def draw(self, gaps: NDArray[np.int64], frames: int, rng: np.random.Generator) -> Scenes:
        """Scenes of so many frames.

        Args:
            gaps: `[N]`, frames from the first frame to the second; all others follow each other.
            frames: T.
            rng: source of all chance.
        """
        return _Draw(self, gaps, frames, rng).scenes()

    def stills(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """So many stills, drawn by their weights."""
        places = np.searchsorted(self._cumulative, rng.random(count) * self._cumulative[-1])
        return np.minimum(places, len(self._cumulative) - 1)


class _Draw:
    """One batch of scenes while it is drawn; all arrays have a row for each scene."""

    def __init__(
        self,
        drawer: SceneDrawer,
        gaps: NDArray[np.int64],
        frames: int,
        rng: np.random.Generator,
    ) -> None:
        self.drawer, self.index, self.config, self.rng = drawer, drawer.index, drawer.config, rng
        self.n, self.t = len(gaps), frames
        times = np.tile(np.arange(frames), (self.n, 1))
        times[:, 1:] += gaps[:, None] - 1
        self.times = times  # [N, T]
        self.elapsed = np.diff(times, axis=1, prepend=times[:, :1] - 1).astype(np.float64)

    def scenes(self) -> Scenes:
        rng, config, n, t = self.rng, self.config, self.n, self.t
        target = self._objects(self.drawer.stills(n, rng))
        unit = _log_uniform(config.object_pixels, n, rng)
        leaves = rng.random(n) < chance_of_leaving(config.leaves, t)
        ways = {
            int(row): config.leaves_by[int(rng.integers(len(config.leaves_by)))]
            for row in np.flatnonzero(leaves)
        }
        # Its own picture shows it a second time: it would stay behind where the object leaves.
        foreign = (rng.random(n) < config.foreign) | leaves
        backdrop = np.where(foreign, self.drawer.stills(n, rng), target.still)
        self.unit = unit
        picture = self.index.image_sizes[self.index.still_image[backdrop]].astype(np.float64)
        zoom = unit / target.side * np.exp(rng.normal(0.0, 0.35, n))
        room = rng.uniform(*config.room, n) * unit
        zoom = np.maximum(zoom, 0.8 * room / picture.min(axis=1))
        extent = picture * zoom[:, None]
        share = rng.uniform(0.7, 1.0, n)
        self.size = np.floor(np.maximum(extent * share[:, None], room[:, None]))

        self.image = np.zeros((t, n, LAYERS), dtype=np.int64)
        self.to_scene = np.zeros((t, n, LAYERS, 2, 3))
        self.to_scene[..., 0, 0] = self.to_scene[..., 1, 1] = 1.0
        self.rectangle = np.tile([0.0, 0.0, 1.0, 1.0], (n, LAYERS, 1))
        self.opaque = np.full((n, LAYERS), ABSENT)
        self.shown = np.ones((t, n, LAYERS), dtype=bool)
        self.number = np.zeros((n, LAYERS), dtype=np.int64)
        self.amplitude = np.zeros((t, n, LAYERS, BENDING_MODES, 2))
        self.frequency = rng.normal(0.0, 0.45, (n, LAYERS, BENDING_MODES, 2))
        self.phase = rng.uniform(0.0, 2 * np.pi, (n, LAYERS, BENDING_MODES, 2))

        self._backdrop(backdrop, zoom, picture, (extent - self.size) / 2)
        centres = self._wander(_log_uniform(config.speed, n, rng))
        everywhere = np.ones(n, dtype=bool)
        self._place(TARGET, target, unit / target.side, centres, everywhere)
        boxes = self._boxes(target)
        middle = (boxes[..., :2] + boxes[..., 2:]).transpose(1, 0, 2) / 2  # [N, T, 2]
        self._companion(TWIN, target, middle, rng.random(n) < config.twin)
        self._companion(OTHER, self._neighbour(target), middle, rng.random(n) < config.other)
        self._occluders(target, middle)
        scenes = Scenes(
            self.image,
            self.to_scene,
            self.rectangle,
            self.opaque,
            self.shown,
            self.number,
            (self.amplitude, self.frequency, self.phase),
            self.size,
            boxes,
            self.index.still_source[target.still],
        )
        if ways:
            leave(scenes, ways, self.times, self._patches(self._objects(backdrop)), rng)
        return scenes

    def _objects(self, stills: NDArray[np.int64]) -> CutOuts:
        """One object of each still."""
        index = self.index
        which = np.floor(self.rng.random(len(stills)) * index.objects[stills]).astype(np.int64)
        return self._cut_out(stills, index.first_object[stills] + which)

    def _cut_out(self, stills: NDArray[np.int64], rows: NDArray[np.int64]) -> CutOuts:
        number = self.index.object_number[rows]
        return CutOuts(
            self.index.still_image[stills],
            self.index.object_rectangle[rows],
            number,
            np.where(number > 0, NUMBERED, RECTANGLE),
            stills,
            rows,
        )

    def _neighbour(self, target: CutOuts) -> CutOuts:
        """Another object: half of them from the target's own picture, if that shows several."""
        index, n = self.index, self.n
        own = (self.rng.random(n) < 0.5) & (index.objects[target.still] > 1)
        stills = np.where(own, target.still, self.drawer.stills(n, self.rng))
        count = index.objects[stills]
        which = np.floor(self.rng.random(n) * count).astype(np.int64)
        rows = index.first_object[stills] + which
        same = rows == target.row
        rows = np.where(same, index.first_object[stills] + (which + 1) % count, rows)
        return self._cut_out(stills, rows)

    def _walk(self, step: Floats | float, *more: int) -> Floats:
        """Random walks `[N, T, *more]` with that standard deviation a frame, `[N]` or one for
        all."""
        steps = np.broadcast_to(step, (self.n,)).reshape(-1, 1, *[1] * len(more))
        elapsed = self.elapsed.reshape(self.n, self.t, *[1] * len(more))
        draws = self.rng.normal(size=(self.n, self.t, *more)) * steps * np.sqrt(elapsed)
        return np.cumsum(draws, axis=1)

    def _wander(self, speed: Floats) -> Floats:
        """Centres `[N, T, 2]` in scene pixels of walks that stay inside the scene."""
        rng, limit, n = self.rng, self.size, self.n
        step = (speed * self.unit)[:, None]
        # Whole inside at first where there is room, so that the clip starts with the object in it.
        margin = np.minimum(0.75 * self.unit[:, None] / limit, 0.45)
        position = rng.uniform(margin, 1.0 - margin) * limit
        velocity = rng.normal(size=(n, 2)) * step
        last = int(self.times[:, -1].max())
        track = np.empty((last + 1, n, 2))
        turns = rng.normal(size=(last + 1, n, 2)) * self.config.turning * step
        for time in range(last + 1):
            track[time] = position
            velocity = 0.95 * velocity + turns[time]
            position = position + velocity
            outside = (position < 0) | (position > limit)
            velocity = np.where(outside, -velocity, velocity)
            position = np.clip(position, 0, limit)
        return track[self.times, np.arange(n)[:, None]]

    def _place(
        self,
        layer: int,
        cut: CutOuts,
        scale: Floats,
        centres: Floats,
        there: NDArray[np.bool_],
        rigid: bool = False,
    ) -> None:
        """Put cut-outs on the paths of their centres; scale, aspect ratio, angle, shape wander."""
        rng, config, n = self.rng, self.config, self.n
        activity = rng.exponential(1.0, n)
        masked = cut.masked & (not rigid)
        log_scale = np.clip(self._walk(config.scaling * activity), -1.2, 1.2)
        log_aspect = np.clip(self._walk(config.stretching * activity), -0.7, 0.7)
        angle = self._walk(config.spinning * activity) * masked[:, None]
        stretch = np.stack([log_scale + log_aspect / 2, log_scale - log_aspect / 2], axis=2)
        stretch = np.exp(stretch - stretch[:, :1]) * scale[:, None, None]  # [N, T, 2]
        cos, sin = np.cos(angle), np.sin(angle)
        maps = np.empty((n, self.t, 2, 3))
        maps[:, :, 0, 0], maps[:, :, 0, 1] = cos * stretch[..., 0], -sin * stretch[..., 1]
        maps[:, :, 1, 0], maps[:, :, 1, 1] = sin * stretch[..., 0], cos * stretch[..., 1]
        middle = (cut.rectangle[:, :2] + cut.rectangle[:, 2:]) / 2
        maps[..., 2] = centres - np.einsum("ntij,nj->nti", maps[..., :2], middle)
        self.to_scene[:, :, layer] = maps.transpose(1, 0, 2, 3)
        self.image[:, :, layer] = cut.image
        self.rectangle[:, layer] = cut.rectangle
        self.number[:, layer] = cut.number
        self.opaque[:, layer] = np.where(there, cut.opaque, ABSENT)
        if rigid:
            return
        bent = masked & (rng.random(n) < config.bent)
        reach = (
            rng.exponential(1.0, (n, BENDING_MODES, 2)) * (config.bending * activity)[:, None, None]
        )
        waves = np.linalg.norm(self.frequency[:, layer], axis=-1, keepdims=True)  # [N, M, 1]
        most = np.minimum(STRONGEST_BEND, STEEPEST_BEND / (2 * np.pi * np.maximum(waves, 1e-6)))
        reach = np.minimum(reach, most) * bent[:, None, None]
        period = np.exp(rng.uniform(np.log(8.0), np.log(80.0), (n, BENDING_MODES, 2)))
        begun = rng.uniform(0.0, 2 * np.pi, (n, BENDING_MODES, 2))
        swing = np.sin(2 * np.pi * self.times[..., None, None] / period[:, None] + begun[:, None])
        self.amplitude[:, :, layer] = (reach[:, None] * swing).transpose(1, 0, 2, 3)

    def _boxes(self, target: CutOuts) -> Floats:
        """Boxes `[T, N, 4]` of the targets, bent as they are."""
        outline = self.index.object_outline[target.row]  # [N, P, 2]
        rectangle = target.rectangle
        low, extent = rectangle[:, None, :2], (rectangle[:, 2:] - rectangle[:, :2])[:, None]
        amplitude = self.amplitude[:, :, TARGET]  # [T, N, M, 2]
        frequency, phase = self.frequency[:, TARGET], self.phase[:, TARGET]
        points = np.broadcast_to(outline, (self.t, *outline.shape))
        if amplitude.any():
            at = points
            for _ in range(BEND_STEPS):  # where q + displacement(q) is the point of the outline
                share = (at - low) / extent  # [T, N, P, 2]
                wave = 2 * np.pi * np.einsum("tnpi,nmi->tnpm", share, frequency)
                moved = np.einsum(
                    "tnmi,tnpmi->tnpi",
                    amplitude,
                    np.sin(wave[..., None] + phase[None, :, None]),
                )
                at = points - moved * extent
            points = at
        maps = self.to_scene[:, :, TARGET]
        placed = np.einsum("tnij,tnpj->tnpi", maps[..., :2], points) + maps[:, :, None, :, 2]
        return np.concatenate([placed.min(axis=2), placed.max(axis=2)], axis=-1)

    def _backdrop(
        self, stills: NDArray[np.int64], zoom: Floats, picture: Floats, margin: Floats
    ) -> None:
        rng, n = self.rng, self.n
        step = _log_uniform(self.config.camera, n, rng) * self.unit
        velocity = self._walk(0.3 * step, 2) + (rng.normal(size=(n, 2)) * step[:, None])[:, None]
        travelled = np.cumsum(velocity * self.elapsed[..., None], axis=1)
        offset = -margin[:, None] + travelled - velocity[:, :1]
        growth = zoom[:, None] * np.exp(self._walk(0.004))
        maps = np.zeros((n, self.t, 2, 3))
        maps[:, :, 0, 0] = maps[:, :, 1, 1] = growth
        maps[..., 2] = offset
        self.to_scene[:, :, BACKGROUND] = maps.transpose(1, 0, 2, 3)
        self.image[:, :, BACKGROUND] = self.index.still_image[stills]
        self.rectangle[:, BACKGROUND, 2:] = picture
        self.opaque[:, BACKGROUND] = WHOLE

    def _companion(
        self, layer: int, cut: CutOuts, centres: Floats, there: NDArray[np.bool_]
    ) -> None:
        """Something that moves near the object, behind it; some of them cross its path."""
        rng, n = self.rng, self.n
        angle = rng.uniform(0, 2 * np.pi, n)
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        distance = rng.uniform(0.8, 2.5, n) * self.unit
        beside = centres[:, 0] + distance[:, None] * direction
        drift = self._walk(0.03 * self.unit, 2)
        follows = rng.uniform(0.0, 1.0, n)[:, None, None]
        path = beside[:, None] + follows * (centres - centres[:, :1]) + drift
        crosses = rng.random(n) < self.config.crossing
        path = np.where(crosses[:, None, None], self._meeting(centres, (0.05, 0.4), 0.3), path)
        scale = self.unit * np.exp(rng.normal(0.0, 0.2, n)) / cut.side
        self._place(layer, cut, scale, path, there)

    def _meeting(self, centres: Floats, speed: tuple[float, float], miss: float) -> Floats:
        """Straight paths `[N, T, 2]` that come past the object in one of the frames.

        Args:
            centres: `[N, T, 2]`, of the object.
            speed: range, log-uniform, per frame in object sizes, beside the object's own.
            miss: standard deviation of the distance at the meeting, in object sizes.
        """
        rng, n = self.rng, self.n
        meeting = rng.integers(self.t, size=n)
        rows = np.arange(n)
        aim = centres[rows, meeting] + rng.normal(size=(n, 2)) * (miss * self.unit)[:, None]
        angle = rng.uniform(0, 2 * np.pi, n)
        pace = _log_uniform(speed, n, rng) * self.unit
        velocity = np.stack([np.cos(angle), np.sin(angle)], axis=1) * pace[:, None]
        ago = (self.times - self.times[rows, meeting][:, None])[..., None]
        return aim[:, None] + ago * velocity[:, None]

    def _occluders(self, target: CutOuts, centres: Floats) -> None:
        """Patches and objects that pass before the object at some moment of the clip."""
        rng, config, n = self.rng, self.config, self.n
        mean = config.occluders * (1.0 if self.t > 8 else 0.5)
        count = np.minimum(rng.poisson(mean, n), OCCLUDERS)
        for place in range(OCCLUDERS):
            cut = self._occluder(target)
            scale = self.unit * rng.uniform(0.4, 1.4, n) / cut.side
            path = self._meeting(centres, (0.02, 0.4), 0.35)
            self._place(TARGET + 1 + place, cut, scale, path, place < count, rigid=True)

    def _occluder(self, target: CutOuts) -> CutOuts:
        """An object of any picture, or a random patch of the target's own."""
        rng, n = self.rng, self.n
        other = self._objects(self.drawer.stills(n, rng))
        patch = self._patches(target)
        is_object = rng.random(n) < self.config.other_occluders
        return CutOuts(
            np.where(is_object, other.image, patch.image),
            np.where(is_object[:, None], other.rectangle, patch.rectangle),
            np.where(is_object, other.number, 0),
            np.where(is_object, other.opaque, patch.opaque),
            target.still,
            target.row,
        )

    def _patches(self, of: CutOuts) -> CutOuts:
        """Random rectangles and ellipses of the pictures that cut-outs are of."""
        rng, n = self.rng, self.n
        picture = self.index.image_sizes[of.image].astype(np.float64)
        side = np.maximum(6.0, picture * rng.uniform(0.1, 0.5, (n, 2)))
        low = rng.uniform(0, 1, (n, 2)) * np.maximum(picture - side, 0.0)
        patch = np.concatenate([low, low + side], axis=1)
        kind = np.where(rng.random(n) < 0.5, RECTANGLE, ELLIPSE)
        return CutOuts(of.image, patch, np.zeros(n, dtype=np.int64), kind, of.still, of.row)


def _log_uniform(limits: tuple[float, float], count: int, rng: np.random.Generator) -> Floats:
    low, high = np.log(limits)
    drawn: Floats = np.exp(rng.uniform(low, high, count))
    return drawn
