"""Weights of one size of `re3-lite` as a start for another size of crop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
import torch.nn.functional as F
from torch import Tensor

from re3.network.lite_config import LiteConfig

POOLING = 4
"""Cells of a view that are averaged before the fully connected layer."""


def refit_weights(
    values: Mapping[str, Tensor], source: LiteConfig, target: LiteConfig
) -> dict[str, Tensor]:
    """Weights for another size of crop, resampled where they belong to places of it.

    A layer that weighs places by where they are is resampled such that it weighs the same places
    relative to the object; what the source has never seen gets no weight.

    Args:
        values: state dictionary of a network of the source's sizes.
        source, target: sizes; they differ in nothing but name and crops.

    Raises:
        ValueError: they differ in more.
    """
    if replace(source, name=target.name, current=target.current) != target:
        raise ValueError(
            f"weights of {source.name!r} cannot be refitted to {target.name!r}: expected networks "
            "that differ in their crops only"
        )
    fitted = dict(values)
    ratio = target.template_cells / source.template_cells
    for name in ("correlate_previous", "correlate_first"):
        key = f"head.{name}.reduce.0.weight"
        fitted[key] = _resample(values[key][:, None, :, 0, 0], 1, ratio, target.template_cells)[
            :, 0, :, None, None
        ]
    key = "head.score.0.weight"
    positions = source.template_cells**2
    plain, likeness = values[key].split([values[key].shape[1] - 2 * positions, 2 * positions], 1)
    resampled = _resample(likeness.unflatten(1, (2, positions)), 1, ratio, target.template_cells)
    fitted[key] = torch.cat([plain, resampled.flatten(1)], dim=1)
    key = "head.fully_connected.0.weight"
    grid, channels = source.grid // 2, source.fused // 2
    seen, pooled = values[key].split(
        [grid**2 * channels, values[key].shape[1] - grid**2 * channels], 1
    )
    wider = target.current.context / source.current.context
    seen = _resample(
        seen.unflatten(1, (channels, grid**2)),
        wider,
        target.grid / source.grid,
        target.grid // 2,
    )
    pooled = _resample(
        pooled.unflatten(1, (source.embedding, -1)),
        1,
        target.view_cells / source.view_cells,
        target.view_cells // POOLING,
    )
    fitted[key] = torch.cat([seen.flatten(1), pooled.flatten(1)], dim=1)
    return fitted


def _resample(weights: Tensor, wider: float, ratio: float, cells: int) -> Tensor:
    """Weights `[O, C, G * G]` of places on a grid, on another grid about the same centre.

    Args:
        weights: of the places, row by row.
        wider: how many times as far the new grid reaches.
        ratio: cells a side of the new grid for each of the old, before any rounding.
        cells: a side of the new grid.
    """
    side = round(weights.shape[2] ** 0.5)
    steps = (torch.arange(cells, dtype=weights.dtype) + 0.5) * 2 / cells - 1
    x, y = torch.meshgrid(steps * wider, steps * wider, indexing="xy")
    grid = torch.stack([x, y], dim=2)[None].expand(len(weights), -1, -1, -1)
    places = F.grid_sample(
        weights.unflatten(2, (side, side)), grid, padding_mode="zeros", align_corners=False
    )
    # The sum over places stays: a cell stands for so much of the old grid.
    return (places * (wider / ratio) ** 2).flatten(2)
