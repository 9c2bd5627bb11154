"""Draws batches of clips from packed data: which pictures, paths, shapes and camera effects."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from re3.data.sampling_config import SamplingConfig
from re3.geometry import Floats
from re3.training.packed.clips import ABSENT, BENDING_MODES, LAYERS, WHOLE, ClipBatch
from re3.training.packed.index import PackedIndex, TrackTable
from re3.training.packed.lens import draw_lens
from re3.training.packed.scenes import SceneDrawer, Scenes

TRIES = 20
"""Draws of a recorded clip with a temporal gap, before one without is taken."""
LEAST_SHARE = 0.15
"""An object of which less than this share is inside the scene counts as absent."""


class ClipDrawer:
    """Draws clips; the same generator gives the same batch.

    Args:
        index: what can be drawn.
        config: how clips are drawn.

    Raises:
        ValueError: the configuration asks for what only the unpacked path has.
    """

    def __init__(self, index: PackedIndex, config: SamplingConfig) -> None:
        if len(set(config.fill)) > 1 or config.fill != config.simulation.fill:
            raise ValueError(
                f"fill is {config.fill} and that of the simulation {config.simulation.fill}; "
                "expected one grey for both when training from packed data"
            )
        self.index, self.config = index, config
        self.scenes = SceneDrawer(index, config.simulation) if len(index.still_image) else None

    @property
    def simulated(self) -> float:
        """Share of simulated clips."""
        if self.scenes is not None and self.index.tracks:
            return self.config.simulated
        return float(self.scenes is not None)

    def draw(self, clips: int, frames: int, rng: np.random.Generator) -> ClipBatch:
        """A batch of clips with the object present in the first frame.

        Args:
            clips: N.
            frames: T, of each.
            rng: source of all chance.
        """
        n, t, config = clips, frames, self.config
        from_stills = rng.random(n) < self.simulated
        leaps = (rng.random(n) < config.leaps) & (t > 1)
        image = np.zeros((t, n, LAYERS), dtype=np.int64)
        to_picture = np.zeros((t, n, LAYERS, 2, 3))
        to_picture[..., 0, 0] = to_picture[..., 1, 1] = 1.0
        rectangle = np.tile([0.0, 0.0, 1.0, 1.0], (n, LAYERS, 1))
        opaque = np.full((n, LAYERS), ABSENT)
        shown = np.ones((t, n, LAYERS), dtype=bool)
        number = np.zeros((n, LAYERS), dtype=np.int64)
        amplitude = np.zeros((t, n, LAYERS, BENDING_MODES, 2))
        frequency = np.zeros((n, LAYERS, BENDING_MODES, 2))
        phase = np.zeros((n, LAYERS, BENDING_MODES, 2))
        size = np.ones((n, 2))
        boxes = np.full((t, n, 4), np.nan)
        source = np.zeros(n, dtype=np.int64)

        for row in np.flatnonzero(~from_stills):
            track, indices, leaps[row] = self._recorded(t, bool(leaps[row]), rng)
            image[:, row, 0] = track.first_image + indices
            opaque[row, 0] = WHOLE
            size[row] = track.width, track.height
            boxes[:, row] = track.boxes_xyxy[indices]
            source[row] = track.source
        rows = np.flatnonzero(from_stills)
        if len(rows):
            assert self.scenes is not None, "stills are only drawn where there are some"
            scenes = self._scenes(len(rows), t, leaps[rows], rng)
            image[:, rows] = scenes.image
            to_picture[:, rows] = _inverse(scenes.to_scene)
            rectangle[rows] = scenes.rectangle
            opaque[rows] = scenes.opaque
            shown[:, rows] = scenes.shown
            number[rows] = scenes.number
            amplitude[:, rows], frequency[rows], phase[rows] = scenes.bend
            size[rows] = scenes.size
            boxes[:, rows] = _inside(scenes.boxes_xyxy, scenes.size)
            source[rows] = scenes.source
        self._mirror(to_picture, boxes, size, rng)
        lens = draw_lens(n, t, leaps, config.photometric, rng)
        return ClipBatch(
            image=torch.from_numpy(image),
            to_picture=_single(to_picture),
            rectangle=_single(rectangle),
            opaque=torch.from_numpy(opaque),
            shown=torch.from_numpy(shown),
            number=torch.from_numpy(number),
            bend_amplitude=_single(amplitude),
            bend_frequency=_single(frequency),
            bend_phase=_single(phase),
            size=_single(size),
            boxes_xyxy=_single(boxes),
            leaps=torch.from_numpy(leaps),
            source=torch.from_numpy(source),
            gain=_single(lens.gain),
            offset=_single(lens.offset),
            grey=torch.from_numpy(lens.grey),
            noise=_single(lens.noise),
            blurred=torch.from_numpy(lens.blurred),
            kernels=_single(lens.kernels),
            compressed=torch.from_numpy(lens.compressed),
            quality=_single(lens.quality),
        )

    def _scenes(
        self, count: int, frames: int, leaps: NDArray[np.bool_], rng: np.random.Generator
    ) -> Scenes:
        """Scenes whose object is in sight at first, on both sides of a temporal gap."""
        assert self.scenes is not None
        low, high = np.log(self.config.leap_simulated)
        gaps = np.where(leaps, np.exp(rng.uniform(low, high, count)).round(), 1).astype(np.int64)
        scenes = self.scenes.draw(gaps, frames, rng)
        for _ in range(TRIES):
            inside = _inside(scenes.boxes_xyxy, scenes.size)
            absent = np.isnan(inside[:2, :, 0])
            lacking = absent[0] | (absent[-1] & leaps)
            again = np.flatnonzero(lacking)
            if not len(again):
                break
            scenes.replace(again, self.scenes.draw(gaps[again], frames, rng))
        return scenes

    def _recorded(
        self, frames: int, leaps: bool, rng: np.random.Generator
    ) -> tuple[TrackTable, NDArray[np.int64], bool]:
        """A track, its frames that are shown, and whether there is a temporal gap.

        The source is drawn once: clips that start without the object are drawn again within it.
        """
        index = self.index
        track = index.tracks[int(rng.choice(len(index.tracks), p=index.track_weights))]
        for attempt in range(TRIES):
            indices = self._window(track, frames, leaps, rng)
            present = ~np.isnan(track.boxes_xyxy[indices[: 1 + leaps], 0])
            if present.all():
                return track, indices, leaps
            if attempt == TRIES // 2:
                leaps = False
        first = track.annotated[np.argmin(np.abs(track.annotated - indices[0]))]
        indices = np.clip(indices + (first - indices[0]), 0, len(track.boxes_xyxy) - 1)
        return track, indices, False

    def _window(
        self, track: TrackTable, frames: int, leaps: bool, rng: np.random.Generator
    ) -> NDArray[np.int64]:
        config, length = self.config, len(track.boxes_xyxy)
        stride = int(rng.choice(config.strides))
        if (frames - 1) * stride >= length:  # a short track is walked at the stride that fits
            stride = max(1, (length - 1) // max(frames - 1, 1))
        span = (frames - 1) * stride
        first = int(np.clip(rng.choice(track.annotated), 0, max(length - 1 - span, 0)))
        indices = np.minimum(first + stride * np.arange(frames), length - 1)
        if rng.random() < config.reversed:
            indices = indices[::-1].copy()
        if leaps:
            low, high = np.log(config.leap_frames)
            gap = round(float(np.exp(rng.uniform(low, high)))) * int(rng.choice([-1, 1]))
            indices[0] = np.clip(indices[1] - gap, 0, length - 1)
        return indices

    def _mirror(
        self, to_picture: Floats, boxes: Floats, size: Floats, rng: np.random.Generator
    ) -> None:
        """Mirror some of the clips about the middle of their scene, in place."""
        rows = np.flatnonzero(rng.random(len(size)) < self.config.mirrored)
        width = size[rows, 0]
        maps = to_picture[:, rows]
        maps[..., 2] += maps[..., 0] * width[None, :, None, None]
        maps[..., 0] *= -1.0
        to_picture[:, rows] = maps
        flipped = boxes[:, rows]
        flipped[..., [0, 2]] = width[None, :, None] - flipped[..., [2, 0]]
        boxes[:, rows] = flipped


def _inverse(to_scene: Floats) -> Floats:
    """Affine maps `[..., 2, 3]` the other way round."""
    matrix = np.linalg.inv(to_scene[..., :2])
    offset = -(matrix @ to_scene[..., 2:])
    return np.concatenate([matrix, offset], axis=-1)


def _inside(boxes_xyxy: Floats, size: Floats) -> Floats:
    """Boxes `[T, N, 4]` cut at the scene's border; NaN where too little is left."""
    inside = np.clip(boxes_xyxy, 0.0, np.tile(size, 2))
    area = np.prod(boxes_xyxy[..., 2:] - boxes_xyxy[..., :2], axis=-1)
    share = np.prod(inside[..., 2:] - inside[..., :2], axis=-1) / np.maximum(area, 1e-6)
    return np.where(share[..., None] < LEAST_SHARE, np.nan, inside)


def _single(values: Floats) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
