"""Roll-outs: tracks walked without gradients, so that one batched pass can learn from them.

Which crops a step sees depends on what the network said at the step before (Re3, sec. III-B,
"Learning to Fix Mistakes"). With the trunk frozen, the crops' features are all that the pass with
gradients needs.
"""

from __future__ import annotations

from collections.abc import Sequence as Several
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from re3 import geometry
from re3.data.augment import AugmentedClip
from re3.data.clip import Clip
from re3.geometry import Floats
from re3.model_spec import CropSpec
from re3.network.base import Maps, Seen, TrackingNetwork
from re3.training.draws import Draws
from re3.training.features import Trunk
from re3.training.recipe import CropNoise
from re3.training.rollout_rules import HIDDEN, REACH, READABLE, SWELL
from re3.training.throughput import Stopwatch


@dataclass(frozen=True, eq=False)
class Rollout:
    """All steps of a batch of tracks, step-major `[steps * N, ...]`.

    Attributes:
        images: the current crops, uint8 `[steps * N, S, S, 3]` BGR.
        crops: their trunk maps.
        looked: `[steps * N, 4]`, the box of the frame before that each crop was cut about, in the
            crop of the step before, regression units; 0 for the first step.
        targets: `[steps * N, 4]` true corners in regression units; 0 where there are none.
        has_box: `[steps * N]`, 1 where the object is present, its centre inside the current crop,
            and its size one that the crop can show.
        hidden: `[steps * N]`, 1 where it is all but hidden.
        steps: number of steps, the initialisation frame included.
        put_back: share of own predictions that had to be put back on the truth.
        previous_images, previous: the previous crops, about the same box, and their trunk maps;
            None for a network that takes none.
        sources: `[N]`, of each sequence; empty where a clip does not say.
        outlines: `[steps * N, G, G]`, share of each cell of the current crops that shows the
            object; NaN where that is not known, None where it was not asked for.
    """

    images: NDArray[np.uint8]
    crops: Maps
    looked: Tensor
    targets: Tensor
    has_box: Tensor
    hidden: Tensor
    steps: int
    put_back: float
    previous_images: NDArray[np.uint8] | None = None
    previous: Maps | None = None
    sources: tuple[str, ...] = ()
    outlines: Tensor | None = None

    def rows(self, sequences: NDArray[np.int64]) -> Tensor:
        """Places of all steps of some sequences, step-major; sequences by place in the batch."""
        batch = len(self.targets) // self.steps
        return torch.from_numpy((np.arange(self.steps)[:, None] * batch + sequences).reshape(-1))

    def part(self, sequences: NDArray[np.int64]) -> Rollout:
        """The roll-out of some of its sequences, by their position in the batch."""
        rows, before = self.rows(sequences), self.previous_images
        return replace(
            self,
            images=self.images[rows.numpy()],
            previous_images=None if before is None else before[rows.numpy()],
            crops=_pick(self.crops, rows),
            previous=None if self.previous is None else _pick(self.previous, rows),
            looked=self.looked[rows],
            targets=self.targets[rows],
            has_box=self.has_box[rows],
            hidden=self.hidden[rows],
            sources=tuple(self.sources[index] for index in sequences) if self.sources else (),
            outlines=None if self.outlines is None else self.outlines[rows],
        )


def roll_out(
    clips: Several[Clip],
    own: NDArray[np.bool_],
    network: TrackingNetwork,
    trunk: Trunk,
    noise: CropNoise,
    rng: Draws,
    pool: Executor,
    watch: Stopwatch | None = None,
    outlined: bool = False,
) -> Rollout:
    """Walk the clips from their first frame to their last.

    Args:
        clips: N clips of equal length; the object is present in the first frame.
        own: `[N]`, True where crops are cut at the network's own predictions. These go on by
            themselves while the object is absent, within the frame as the tracker keeps them; the
            others stay where the object was last.
        network: decides where it looks next.
        trunk: of the network, on its device.
        noise: disturbance of the crops.
        rng: source of the noise.
        pool: cuts crops in parallel.
        watch: gets the time of `crops`, `features` and `walk`.
        outlined: outlines are asked for, of a network that draws them.
    """
    watch = watch or Stopwatch()
    spec = network.spec()
    truth = np.stack([clip.boxes_xyxy for clip in clips])  # [N, T, 4]
    visible = np.stack([clip.visible for clip in clips])  # [N, T]
    leaps = np.array([clip.leaps for clip in clips])  # [N]
    objects, steps = truth.shape[:2]
    boxes = truth[:, 0].copy()
    stays = rng.random(objects) < noise.stay_lost
    held = _held(own, noise, rng)
    device = next(network.parameters()).device
    images: list[NDArray[np.uint8]] = []
    maps: list[Maps] = []
    previous_images: list[NDArray[np.uint8]] = []
    previous: list[Maps] = []
    looked: list[Floats] = []
    outlines: list[Tensor] = []
    targets, has_box, put_back = [], [], 0
    memory: Any | None = None
    regions = geometry.search_region(boxes, spec.current.context)
    for t in range(steps):
        # After a leap the object may be anywhere: the crop is cut at the truth of its own frame.
        leapt = leaps & (t == 1)
        start = np.where(leapt[:, None], truth[:, t], boxes)
        about, new_regions = _regions(start, held, own & ~leapt, t, noise, rng, spec.current)
        # What is known of the frame before is still about the box found there.
        known = np.where(leapt[:, None], boxes, about)
        looked.append(geometry.encode(known, regions) if t else np.zeros((objects, 4)))
        regions = new_regions
        with watch.time("crops"):
            images.append(_crops(clips, t, regions, spec.current.size, pool))
            if outlined and network.outline_cells:
                outlines.append(_outlines(clips, t, regions, network.outline_cells, pool))
        with watch.time("features"):
            maps.append(trunk(images[-1]))
        if spec.previous is not None:
            around, side = geometry.search_region(known, spec.previous.context), spec.previous.size
            with watch.time("crops"):
                previous_images.append(_crops(clips, max(t - 1, 0), around, side, pool))
            with watch.time("features"):
                previous.append(trunk(previous_images[-1]))

        target = geometry.encode(truth[:, t], regions)
        centre = (target[:, :2] + target[:, 2:]) / 2 / geometry.REGRESSION_SCALE
        with np.errstate(invalid="ignore"):
            # False for NaN, where the object is absent.
            inside = np.abs(centre - 0.5).max(axis=1) < 0.5
            sides = target[:, 2:] - target[:, :2]
            inside &= ((sides > READABLE[0]) & (sides < READABLE[1])).all(axis=1)
        targets.append(np.where(inside[:, None], target, 0.0))
        has_box.append(inside)

        present = ~np.isnan(truth[:, t, 0])
        boxes = np.where(present[:, None], truth[:, t], boxes)
        if own.any() and t < steps - 1:
            with torch.no_grad(), watch.time("walk"):
                at = torch.from_numpy(looked[-1]).float().to(device)
                before = previous[-1] if previous else None
                corners, memory = network.walk(Seen(maps[-1], before, at), memory)
            if t == 0:
                continue  # the box given is the first result
            predicted = geometry.decode(corners.float().cpu().numpy(), regions)
            usable = own & (_usable(predicted, truth[:, t], centre) | (stays & _sane(predicted)))
            put_back += int((own & ~usable).sum())
            boxes = np.where(usable[:, None], _kept_inside(predicted, clips), boxes)
    return Rollout(
        images=np.concatenate(images),
        crops=_stack(maps),
        looked=torch.from_numpy(np.concatenate(looked)).float(),
        targets=torch.from_numpy(np.concatenate(targets)).float(),
        has_box=torch.from_numpy(np.concatenate(has_box)).float(),
        hidden=torch.from_numpy((visible.T.reshape(-1) < HIDDEN).astype(np.float32)),
        steps=steps,
        put_back=put_back / max(1, int(own.sum()) * (steps - 2)),
        previous_images=np.concatenate(previous_images) if previous_images else None,
        previous=_stack(previous) if previous else None,
        sources=tuple(_source(clip) for clip in clips),
        outlines=torch.cat(outlines) if outlines else None,
    )


def _held(own: NDArray[np.bool_], noise: CropNoise, rng: Draws) -> Floats:
    """Errors `[N, 2]` of the log of width and height that last for a track."""
    scale = np.where(own, noise.held_own, noise.held)[:, None]
    drawn = rng.laplace(0, 1.0, (len(own), 2)) * scale
    return np.clip(drawn, -3 * scale, 3 * scale)


def _regions(
    boxes: Floats,
    held: Floats,
    own: NDArray[np.bool_],
    t: int,
    noise: CropNoise,
    rng: Draws,
    crop: CropSpec,
) -> tuple[Floats, Floats]:
    """Boxes `[N, 4]` of the frame before as the tracker might have them, and regions to crop."""
    n = len(boxes)
    at = geometry.convert(boxes, "xyxy", "cxcywh")
    at[:, 2:] = np.maximum(at[:, 2:], geometry.SMALLEST_SIDE)
    # A given box is nearly right. Own predictions set out from a box that is a little off, so that
    # finding back is learnt over several steps, and are on their own after that.
    strength = np.full(n, 0.1) if t == 0 else np.where(own, 0.5 * (t == 1), 1.0)
    shift = np.clip(rng.laplace(0, noise.drift, (n, 2)), -noise.drift_limit, noise.drift_limit)
    growth = np.clip(
        rng.laplace(0, noise.drift_scale, (n, 2)), -noise.drift_scale_limit, noise.drift_scale_limit
    )
    at[:, :2] += shift * strength[:, None] * at[:, 2:]
    at[:, 2:] *= np.exp(growth * strength[:, None] + (held if t > 0 else 0.0))
    looked = geometry.convert(at, "cxcywh", "xyxy")
    if t > 0:
        jumps = (rng.random(n) < np.where(own, noise.jumps_own, noise.jumps))[:, None]
        jump = np.clip(rng.laplace(0, noise.jump, (n, 2)), -noise.jump_limit, noise.jump_limit)
        blind = (rng.random(n) < np.where(own, 0.0, noise.blind))[:, None]
        angle = rng.uniform(0, 2 * np.pi, n)
        away = 2.2 * crop.context * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        at[:, :2] += np.where(blind, away, jump * jumps) * at[:, 2:]
        at[:, 2:] *= np.exp(np.clip(rng.laplace(0, noise.jump_scale, (n, 2)), -0.3, 0.3) * jumps)
    return (
        looked,
        geometry.search_region(geometry.convert(at, "cxcywh", "xyxy"), crop.context),
    )


def _crops(
    clips: Several[Clip], frame: int, regions: Floats, size: int, pool: Executor
) -> NDArray[np.uint8]:
    return np.stack(list(pool.map(lambda c, r: c.crop(frame, r, size), clips, regions)))


def _outlines(
    clips: Several[Clip], frame: int, regions: Floats, cells: int, pool: Executor
) -> Tensor:
    """`[N, cells, cells]`, NaN where not known."""
    found = pool.map(lambda c, r: c.outline(frame, r, cells), clips, regions)
    unknown = np.full((cells, cells), np.nan, dtype=np.float32)
    return torch.from_numpy(np.stack([unknown if o is None else o for o in found]))


def _source(clip: Clip) -> str:
    origin = clip.origin if isinstance(clip, AugmentedClip) else None
    return "" if origin is None else origin.source


def _sane(predicted: Floats) -> NDArray[np.bool_]:
    """Whether a prediction is a box at all."""
    smallest: Floats = (predicted[:, 2:] - predicted[:, :2]).min(axis=1)
    return smallest > geometry.SMALLEST_SIDE


def _usable(predicted: Floats, truth: Floats, centre: Floats) -> NDArray[np.bool_]:
    """Whether tracking can go on from a prediction; where the truth is unknown, it can."""
    size = predicted[:, 2:] - predicted[:, :2]
    area = np.prod(np.maximum(size, geometry.SMALLEST_SIDE), axis=1)
    true_area = np.prod(truth[:, 2:] - truth[:, :2], axis=1)
    with np.errstate(invalid="ignore"):
        near = (np.abs(centre - 0.5) < REACH / 2).all(axis=1)
        alike = np.abs(np.log(area / true_area)) < np.log(SWELL)
    return _sane(predicted) & ((near & alike) | np.isnan(true_area))


def _kept_inside(predicted: Floats, clips: Several[Clip]) -> Floats:
    """Predictions as the tracker keeps them: their centre within the frame."""
    frames = np.stack([clip.frame_xyxy for clip in clips])
    origin = np.tile(frames[:, :2], 2)
    sizes = frames[:, 2:] - frames[:, :2]
    inside = [
        geometry.clip_inside(box, width, height)
        for box, (width, height) in zip(predicted - origin, sizes, strict=True)
    ]
    return np.stack(inside) + origin


def _stack(maps: list[Maps]) -> Maps:
    return tuple(torch.cat(parts) for parts in zip(*maps, strict=True))


def _pick(maps: Maps, rows: Tensor) -> Maps:
    return tuple(one[rows] for one in maps)
