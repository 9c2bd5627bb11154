"""Walks a batch of clips on the device: crops, embeddings with gradients, and targets.

The rules are those of `re3.training.rollout` (Re3, sec. III-B, "Learning to Fix Mistakes"), on
tensors: nothing waits for the device.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from re3.geometry import REGRESSION_SCALE, SMALLEST_SIDE
from re3.model_spec import CropSpec
from re3.network.lite_config import LiteState
from re3.network.re3_lite import Re3Lite
from re3.training.packed.bank import ImageBank
from re3.training.packed.clips import ABSENT, ClipBatch
from re3.training.packed.photometric import take_picture
from re3.training.packed.render import Layers, Paint, paint, render, visible_share
from re3.training.recipe import CropNoise
from re3.training.rollout_rules import HIDDEN, REACH, READABLE, SWELL


@dataclass(frozen=True, eq=False)
class DeviceRollout:
    """All steps of a batch of tracks, step-major `[T * N, ...]`.

    Attributes:
        embeddings: `[T * N, C, G, G]`, of the current crops, with gradients.
        previous_boxes: `[T * N, 4]`, the previous box, on which each crop is centred, in the crop
            of the step before, regression units; 0 for the first step.
        targets, has_box, hidden: as in `re3.training.rollout.Rollout`.
        recentred: share of own predictions that were replaced by the truth, a scalar.
        crops: uint8 `[T, N, S, S, 3]` BGR of the first clips, for pictures of the training; or
            None.
    """

    embeddings: Tensor
    previous_boxes: Tensor
    targets: Tensor
    has_box: Tensor
    hidden: Tensor
    recentred: Tensor
    crops: Tensor | None = None


class Renderer:
    """Cuts crops of clips.

    Args:
        bank: the pictures.
        fill: grey value outside frames and scenes.
        compiled: fuse the drawing with `torch.compile`.
    """

    def __init__(self, bank: ImageBank, fill: float, compiled: bool = False) -> None:
        self.bank, self.fill = bank, fill
        self._paint: Paint = torch.compile(paint, dynamic=False) if compiled else paint

    def crops(
        self, clips: ClipBatch, frame: int, regions: Tensor, size: int, generator: torch.Generator
    ) -> Tensor:
        """Crops of all clips in a frame, float32 `[N, size, size, 3]` BGR.

        Args:
            clips: on the device.
            frame: 0 to T - 1.
            regions: `[N, 4]`, xyxy in pixels of frames or scenes.
            size: side of the crops in pixels.
            generator: of the sensors' noise.
        """
        layers = self._layers(clips, slice(frame, frame + 1))
        crops = render(layers, clips.size, regions, size, self.fill, self._paint)
        return take_picture(crops, clips, frame, generator)

    def visible(self, clips: ClipBatch) -> Tensor:
        """Share `[T, N]` of each object that is not occluded."""
        layers = self._layers(clips, slice(None))
        share = visible_share(layers, clips.boxes_xyxy.flatten(0, 1))
        return share.unflatten(0, (clips.frames, clips.clips))

    def _layers(self, clips: ClipBatch, frames: slice) -> Layers:
        """The layers of some frames, one frame after the other."""
        shown = clips.shown[frames]
        count = len(shown)

        def each(values: Tensor) -> Tensor:
            return values.repeat(count, *[1] * (values.dim() - 1)) if count > 1 else values

        return Layers(
            pixels=self.bank.pixels,
            offsets=self.bank.offsets,
            sizes=self.bank.sizes,
            image=clips.image[frames].flatten(0, 1),
            to_picture=clips.to_picture[frames].flatten(0, 1),
            rectangle=each(clips.rectangle),
            opaque=torch.where(shown, clips.opaque, ABSENT).flatten(0, 1),
            number=each(clips.number),
            bend_amplitude=clips.bend_amplitude[frames].flatten(0, 1),
            bend_frequency=each(clips.bend_frequency),
            bend_phase=each(clips.bend_phase),
        )


def roll_out(
    clips: ClipBatch,
    own: Tensor,
    network: Re3Lite,
    embed: Callable[[Tensor], Tensor],
    renderer: Renderer,
    noise: CropNoise,
    generator: torch.Generator,
    pictured: int = 0,
) -> DeviceRollout:
    """Walk the clips from their first frame to their last.

    Args:
        clips: N clips of T frames, on the device; the object is present in the first frame.
        own: bool `[N]`, True where crops are cut at the network's own predictions.
        network: decides where these look next.
        embed: crops float32 `[N, S, S, 3]` to embeddings `[N, C, G, G]`, with gradients.
        renderer: cuts the crops.
        noise: disturbance of the crops.
        generator: of the noise, on the device.
        pictured: crops of so many clips are kept.
    """
    crop = network.config.current
    steps, objects = clips.frames, clips.clips
    truth = clips.boxes_xyxy
    draws = Draws(generator, truth.device)
    boxes = truth[0].clone()
    stays = draws.uniform(objects) < noise.stay_lost
    scale = torch.where(own, noise.held_own, noise.held)[:, None]
    held = (draws.laplace(objects, 2) * scale).clamp(-3 * scale, 3 * scale)
    regions = search_region(boxes, crop.context)
    embeddings, previous, targets, has_box, pictures = [], [], [], [], []
    recentred = truth.new_zeros(())
    state = network.zero_state(objects, truth.device)
    for t in range(steps):
        leapt = clips.leaps & (t == 1)
        start = torch.where(leapt[:, None], truth[t], boxes)
        about, new_regions = _regions(start, held, own & ~leapt, t, noise, draws, crop)
        known = torch.where(leapt[:, None], boxes, about)
        previous.append(encode(known, regions) if t else torch.zeros_like(boxes))
        regions = new_regions
        crops = renderer.crops(clips, t, regions, crop.size, generator)
        if pictured:
            pictures.append(crops[:pictured].to(torch.uint8))
        embeddings.append(embed(crops))

        target = encode(truth[t], regions)
        centre = (target[:, :2] + target[:, 2:]) / 2 / REGRESSION_SCALE
        sides = target[:, 2:] - target[:, :2]
        # Comparisons with NaN, where the object is absent, are False.
        inside = (centre - 0.5).abs().amax(dim=1) < 0.5
        inside &= ((sides > READABLE[0]) & (sides < READABLE[1])).all(dim=1)
        targets.append(torch.where(inside[:, None], target, 0.0))
        has_box.append(inside)

        present = ~truth[t, :, 0].isnan()
        boxes = torch.where(present[:, None], truth[t], boxes)
        if t == steps - 1:
            break
        corners, state = _step(network, embeddings[-1], previous[-1], state, t)
        if t == 0:
            continue  # the given box is the first result
        predicted = decode(corners, regions)
        usable = _usable(predicted, truth[t], centre) | (stays & _is_box(predicted))
        recentred = recentred + (own & ~usable).sum()
        kept = _keep_inside(predicted, clips.size)
        boxes = torch.where((own & usable)[:, None], kept, boxes)
    return DeviceRollout(
        embeddings=torch.cat(embeddings),
        previous_boxes=torch.cat(previous),
        targets=torch.cat(targets),
        has_box=torch.cat(has_box).float(),
        hidden=(renderer.visible(clips) < HIDDEN).flatten().float(),
        recentred=recentred / (own.sum() * max(1, steps - 2)).clamp(min=1),
        crops=torch.stack(pictures) if pictures else None,
    )


@torch.no_grad()
def _step(
    network: Re3Lite, embedding: Tensor, previous: Tensor, state: LiteState, t: int
) -> tuple[Tensor, LiteState]:
    """Corners `[N, 4]` of one step, and the state after it."""
    if t:
        # `state.view` is, between steps, the whole embedding of the step before.
        state = state._replace(view=network.head.view(state.view, previous).float())
    with torch.autocast(embedding.device.type, enabled=False):
        output, state = network.head(embedding.detach().float(), state)
    return output.corners, state._replace(view=embedding.detach().float())


class Draws:
    """Random numbers on the device.

    Args:
        generator: their source.
        device: of the numbers.
    """

    def __init__(self, generator: torch.Generator, device: torch.device) -> None:
        self.generator, self.device = generator, device

    def uniform(self, *size: int) -> Tensor:
        """From 0 to 1."""
        return torch.rand(size, generator=self.generator, device=self.device)

    def laplace(self, *size: int) -> Tensor:
        """Of scale 1 about 0."""
        share = self.uniform(*size) - 0.5
        return -share.sign() * torch.log((1 - 2 * share.abs()).clamp(min=1e-7))


def _regions(
    boxes: Tensor,
    held: Tensor,
    own: Tensor,
    t: int,
    noise: CropNoise,
    draws: Draws,
    crop: CropSpec,
) -> tuple[Tensor, Tensor]:
    """Boxes `[N, 4]` of the frame before as the tracker might have them, and regions to crop."""
    n = len(boxes)
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    size = (boxes[:, 2:] - boxes[:, :2]).clamp(min=SMALLEST_SIDE)
    # A given box is nearly right. Own predictions start from a box that is a little off, so that
    # correcting it is learnt over several steps, and are on their own after that.
    if t == 0:
        strength = torch.full_like(middle[:, :1], 0.1)
    else:
        strength = torch.where(own, 0.5 * (t == 1), 1.0)[:, None]
    shift = (draws.laplace(n, 2) * noise.drift).clamp(-noise.drift_limit, noise.drift_limit)
    growth = draws.laplace(n, 2) * noise.drift_scale
    growth = growth.clamp(-noise.drift_scale_limit, noise.drift_scale_limit)
    middle = middle + shift * strength * size
    size = size * torch.exp(growth * strength + (held if t else 0.0))
    about = torch.cat([middle - size / 2, middle + size / 2], dim=1)
    if t:
        jumps = (draws.uniform(n) < torch.where(own, noise.jumps_own, noise.jumps))[:, None]
        jump = (draws.laplace(n, 2) * noise.jump).clamp(-noise.jump_limit, noise.jump_limit)
        blind = (draws.uniform(n) < torch.where(own, 0.0, noise.blind))[:, None]
        angle = draws.uniform(n) * 2 * torch.pi
        away = 2.2 * crop.context * torch.stack([angle.cos(), angle.sin()], dim=1)
        middle = middle + torch.where(blind, away, jump * jumps) * size
        stretch = (draws.laplace(n, 2) * noise.jump_scale).clamp(-0.3, 0.3)
        size = size * torch.exp(stretch * jumps)
    reach = size.clamp(min=SMALLEST_SIDE) * crop.context / 2
    return about, torch.cat([middle - reach, middle + reach], dim=1)


def search_region(boxes_xyxy: Tensor, context: float) -> Tensor:
    """As `re3.geometry.search_region`, on tensors."""
    middle = (boxes_xyxy[:, :2] + boxes_xyxy[:, 2:]) / 2
    reach = (boxes_xyxy[:, 2:] - boxes_xyxy[:, :2]).clamp(min=SMALLEST_SIDE) * context / 2
    return torch.cat([middle - reach, middle + reach], dim=1)


def encode(boxes_xyxy: Tensor, regions: Tensor) -> Tensor:
    """As `re3.geometry.encode`, on tensors."""
    low, extent = regions[:, :2], regions[:, 2:] - regions[:, :2]
    return (boxes_xyxy - low.repeat(1, 2)) / extent.repeat(1, 2) * REGRESSION_SCALE


def decode(corners: Tensor, regions: Tensor) -> Tensor:
    """As `re3.geometry.decode`, on tensors."""
    low, extent = regions[:, :2], regions[:, 2:] - regions[:, :2]
    return corners / REGRESSION_SCALE * extent.repeat(1, 2) + low.repeat(1, 2)


def _is_box(predicted: Tensor) -> Tensor:
    return (predicted[:, 2:] - predicted[:, :2]).amin(dim=1) > SMALLEST_SIDE


def _usable(predicted: Tensor, truth: Tensor, centre: Tensor) -> Tensor:
    """Whether tracking can go on from a prediction; where the truth is unknown, it can."""
    size = (predicted[:, 2:] - predicted[:, :2]).clamp(min=SMALLEST_SIDE)
    ratio = size.prod(dim=1) / (truth[:, 2:] - truth[:, :2]).prod(dim=1)
    near = ((centre - 0.5).abs() < REACH / 2).all(dim=1)
    alike = ratio.log().abs() < math.log(SWELL)
    return _is_box(predicted) & ((near & alike) | truth[:, 0].isnan())


def _keep_inside(boxes_xyxy: Tensor, size: Tensor) -> Tensor:
    """As `re3.geometry.clip_inside`, on tensors: the centre within the frame, a usable size."""
    middle = (boxes_xyxy[:, :2] + boxes_xyxy[:, 2:]) / 2
    middle = torch.minimum(middle.clamp(min=0.0), size)
    half = (boxes_xyxy[:, 2:] - boxes_xyxy[:, :2]).clamp(min=SMALLEST_SIDE)
    half = torch.minimum(half, 4 * size) / 2
    return torch.cat([middle - half, middle + half], dim=1)
