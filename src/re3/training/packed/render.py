"""Crops of clips, made on the device: layers sampled from the image bank and blended.

The functions are pure tensor code: eager, or fused by `torch.compile`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from re3.training.packed.bank import LEVELS
from re3.training.packed.clips import (
    ABSENT,
    ELLIPSE,
    LAYERS,
    NUMBERED,
    RECTANGLE,
    TARGET,
    WHOLE,
)

VISIBILITY_GRID = 24
"""Points a side on which the visible share of an object is counted."""


@dataclass(frozen=True, eq=False)
class Layers:
    """The layers of N clips in one frame; fields as in `ImageBank` and `ClipBatch`.

    Attributes:
        opaque: ABSENT where a layer is not shown.
    """

    pixels: Tensor
    offsets: Tensor
    sizes: Tensor
    image: Tensor
    to_picture: Tensor
    rectangle: Tensor
    opaque: Tensor
    number: Tensor
    bend_amplitude: Tensor
    bend_frequency: Tensor
    bend_phase: Tensor

    def at(self, layer: int) -> tuple[Tensor, ...]:
        """What `paint` needs of one of them."""
        return (
            self.pixels,
            self.offsets,
            self.sizes,
            self.image[:, layer],
            self.to_picture[:, layer],
            self.rectangle[:, layer],
            self.opaque[:, layer],
            self.number[:, layer],
            self.bend_amplitude[:, layer],
            self.bend_frequency[:, layer],
            self.bend_phase[:, layer],
        )


Paint = Callable[..., Tensor]


def render(
    layers: Layers,
    scene: Tensor,
    regions: Tensor,
    size: int,
    fill: float,
    paint: Paint,
) -> Tensor:
    """Crops of N clips in one frame.

    Args:
        layers: from back to front.
        scene: float32 `[N, 2]`, width and height.
        regions: float32 `[N, 4]`, xyxy in scene pixels, what the crops show.
        size: side of the crops in pixels.
        fill: grey value outside the scene.
        paint: the function of that name, or the same compiled.

    Returns:
        float32 `[N, size, size, 3]` BGR, 0 to 255.
    """
    canvas = regions.new_full((len(regions), size, size, 3), fill)
    for layer in range(LAYERS):
        canvas = paint(canvas, regions, *layers.at(layer))
    x, y = _grid(regions, size)
    width, height = scene[:, 0, None, None], scene[:, 1, None, None]
    inside = (x >= 0) & (x <= width) & (y >= 0) & (y <= height)
    return torch.where(inside[..., None], canvas, fill)


def paint(canvas: Tensor, regions: Tensor, *layer: Tensor) -> Tensor:
    """A layer drawn over a canvas `[N, S, S, 3]`; the layer as `Layers.at` gives it."""
    colours, alpha = _layer(regions, canvas.shape[1], *layer)
    return canvas + alpha[..., None] * (torch.stack(colours, dim=-1) - canvas)


def visible_share(layers: Layers, boxes_xyxy: Tensor) -> Tensor:
    """Share `[N]` of each target that no occluder hides; 1 without a target, 0 where it is absent.

    Args:
        layers: of N clips in one frame, or of several frames one after the other.
        boxes_xyxy: float32 `[N, 4]`, of the targets; NaN where absent.
    """
    absent = boxes_xyxy[:, 0].isnan()
    anything = (torch.arange(4, device=boxes_xyxy.device) >= 2).to(boxes_xyxy)  # 0, 0, 1, 1
    regions = torch.where(absent[:, None], anything, boxes_xyxy)
    _, target = _layer(regions, VISIBILITY_GRID, *layers.at(TARGET))
    whole = seen = (target > 0.5).float()
    for layer in range(TARGET + 1, LAYERS):
        _, alpha = _layer(regions, VISIBILITY_GRID, *layers.at(layer))
        seen = seen * (alpha <= 0.5)
    share = seen.sum(dim=(1, 2)) / whole.sum(dim=(1, 2)).clamp(min=1.0)
    share = torch.where(layers.opaque[:, TARGET] == ABSENT, 1.0, share)
    return torch.where(absent, 0.0, share)


def _grid(regions: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Scene coordinates `[N, size, size]` of the crops' pixel centres."""
    steps = (torch.arange(size, device=regions.device, dtype=torch.float32) + 0.5) / size
    low, extent = regions[:, :2], regions[:, 2:] - regions[:, :2]
    x = (low[:, :1] + extent[:, :1] * steps)[:, None, :].expand(-1, size, -1)
    y = (low[:, 1:] + extent[:, 1:] * steps)[:, :, None].expand(-1, -1, size)
    return x, y


def _layer(
    regions: Tensor,
    size: int,
    pixels: Tensor,
    offsets: Tensor,
    sizes: Tensor,
    image: Tensor,
    to_picture: Tensor,
    rectangle: Tensor,
    opaque: Tensor,
    number: Tensor,
    amplitude: Tensor,
    frequency: Tensor,
    phase: Tensor,
) -> tuple[list[Tensor], Tensor]:
    """Blue, green and red of a layer and its opacity, `[N, size, size]` each."""
    x, y = _grid(regions, size)
    m = to_picture[:, :, :, None, None]  # [N, 2, 3, 1, 1]
    u = m[:, 0, 0] * x + m[:, 0, 1] * y + m[:, 0, 2]
    v = m[:, 1, 0] * x + m[:, 1, 1] * y + m[:, 1, 2]
    low, extent = rectangle[:, :2], (rectangle[:, 2:] - rectangle[:, :2]).clamp(min=1.0)
    du, dv = displacement(u, v, low, extent, amplitude, frequency, phase)
    u, v = u + du, v + dv
    # Picture pixels that a crop pixel spans along either axis of the crop.
    step = (regions[:, None, 2:] - regions[:, None, :2]) / size * to_picture[:, :, :2]
    span = step.square().sum(dim=1).sqrt().clamp(min=1e-6)  # [N, 2]
    least, most = span.amin(dim=1), span.amax(dim=1)
    level = (least.clamp(min=1.0).log2() + 1e-3).floor() + (most > 4 * least)
    level = torch.where(most < 2.0, 0.0, level).clamp(max=LEVELS - 1).long()

    width = torch.gather(sizes[image, :, 0], 1, level[:, None])[:, :, None]
    height = torch.gather(sizes[image, :, 1], 1, level[:, None])[:, :, None]
    offset = torch.gather(offsets[image], 1, level[:, None])[:, :, None]
    shrink = torch.exp2(-level.float())[:, None, None]
    px, py = u * shrink - 0.5, v * shrink - 0.5
    # Far outside a picture nothing has to be exact, but integers must not run over.
    px, py = px.clamp(-30000.0, 30000.0), py.clamp(-30000.0, 30000.0)
    left, top = px.floor(), py.floor()
    fx, fy = px - left, py - top
    columns = [_reflect(left.long() + step, width) for step in (0, 1)]
    rows = [_reflect(top.long() + step, height) for step in (0, 1)]
    blue = green = red = match = torch.zeros_like(px)
    target = number[:, None, None]
    for row, wy in zip(rows, (1 - fy, fy), strict=True):
        for column, wx in zip(columns, (1 - fx, fx), strict=True):
            value = pixels[offset + row * width + column]
            weight = wx * wy
            blue = blue + weight * (value & 255)
            green = green + weight * ((value >> 8) & 255)
            red = red + weight * ((value >> 16) & 255)
            match = match + weight * (((value >> 24) & 255) == target)

    # Edges are as soft as a crop pixel is wide.
    soft = most[:, None, None].clamp(min=1.0)
    a, b = (u - low[:, :1, None]), (v - low[:, 1:, None])
    w, h = extent[:, :1, None], extent[:, 1:, None]
    edge = torch.minimum(torch.minimum(a, w - a), torch.minimum(b, h - b))
    radius = ((2 * a / w - 1).square() + (2 * b / h - 1).square()).sqrt()
    round_edge = (1 - radius) * torch.minimum(w, h) / 2
    kind = opaque[:, None, None]
    alpha = torch.where(kind == RECTANGLE, (edge / soft + 0.5).clamp(0, 1), 0.0)
    alpha = torch.where(kind == ELLIPSE, (round_edge / soft + 0.5).clamp(0, 1), alpha)
    # Beyond its rectangle, and in the mirror images of its picture, an object is not shown.
    alpha = torch.where(kind == NUMBERED, match * (edge > -1.0), alpha)
    alpha = torch.where(kind == WHOLE, 1.0, alpha)
    return [blue, green, red], alpha


def displacement(
    u: Tensor,
    v: Tensor,
    low: Tensor,
    extent: Tensor,
    amplitude: Tensor,
    frequency: Tensor,
    phase: Tensor,
) -> tuple[Tensor, Tensor]:
    """Where a bent picture shows what: offsets of picture coordinates.

    Args:
        u, v: `[N, S, S]`, picture coordinates.
        low, extent: `[N, 2]`, of the object's rectangle.
        amplitude, frequency, phase: `[N, M, 2]`; see `ClipBatch`.
    """
    a = (u - low[:, :1, None]) / extent[:, :1, None]
    b = (v - low[:, 1:, None]) / extent[:, 1:, None]
    du = dv = torch.zeros_like(u)
    for mode in range(amplitude.shape[1]):
        wave = 2 * math.pi * (frequency[:, mode, :1, None] * a + frequency[:, mode, 1:, None] * b)
        du = du + amplitude[:, mode, :1, None] * torch.sin(wave + phase[:, mode, :1, None])
        dv = dv + amplitude[:, mode, 1:, None] * torch.sin(wave + phase[:, mode, 1:, None])
    return du * extent[:, :1, None], dv * extent[:, 1:, None]


def _reflect(index: Tensor, length: Tensor) -> Tensor:
    """Indices outside 0..length-1 mirrored back, the border pixel repeated."""
    index = torch.remainder(index, 2 * length)
    return torch.minimum(index, 2 * length - 1 - index)
