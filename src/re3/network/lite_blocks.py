"""Blocks of `re3-lite`'s head: how maps become an embedding, and embeddings are compared."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from re3.network.efficientnet_lite import OUT_CHANNELS
from re3.network.lite_config import LiteConfig

Features = tuple[Tensor, Tensor, Tensor]
"""Trunk maps of one crop at strides 4, 8 and 16."""


class ChannelNorm(nn.Module):
    """Each position's channels to zero mean and unit variance, then scaled and shifted."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels, 1, 1))
        self.bias = nn.Parameter(torch.zeros(channels, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        weight, bias = self.weight.flatten(), self.bias.flatten()
        channels_last = x.permute(0, 2, 3, 1)
        normed = nn.functional.layer_norm(channels_last, weight.shape, weight, bias)
        return normed.permute(0, 3, 1, 2)


def prelu(config: LiteConfig, channels: int) -> nn.PReLU:
    """The activation behind a layer of so many channels."""
    return nn.PReLU(1 if config.lean else channels)


class Adapter(nn.Module):
    """Adds to a map what three convolutions make of it.

    The trunk was trained to tell kinds of things apart, and most of it stays as it is; these blocks
    learn what tells one thing from the next of its kind.
    """

    def __init__(self, config: LiteConfig, channels: int, inside: int) -> None:
        super().__init__()
        self.change = nn.Sequential(
            nn.Conv2d(channels, inside, 1),
            prelu(config, inside),
            nn.Conv2d(inside, inside, 3, padding=1),
            prelu(config, inside),
        )
        self.contract = nn.Conv2d(inside, channels, 1)
        self.sum: nn.Module = nn.Identity()  # rounds in eight bits: `re3.network.quantize`

    def forward(self, x: Tensor) -> Tensor:
        changed: Tensor = self.sum(x + self.contract(self.change(x)))
        return changed


class Embedding(nn.Module):
    """Trunk maps at strides 4, 8, 16 to one map at stride 8 (skip connections, sec. III-A)."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        skip4, skip8, skip16 = config.skips
        self.adapt16 = nn.Sequential(
            Adapter(config, OUT_CHANNELS[16], config.adapter),
            Adapter(config, OUT_CHANNELS[16], config.adapter),
        )
        self.skip4 = nn.Sequential(
            nn.Conv2d(OUT_CHANNELS[4], skip4, 2, stride=2), prelu(config, skip4)
        )
        self.skip8 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[8], skip8, 1), prelu(config, skip8))
        self.skip16 = nn.Sequential(nn.Conv2d(OUT_CHANNELS[16], skip16, 1), prelu(config, skip16))
        self.merge = nn.Conv2d(sum(config.skips), config.embedding, 1)
        self.adapt8 = Adapter(config, config.embedding, config.adapter // 2)
        self.norm = ChannelNorm(config.embedding)

    def forward(self, features: Features) -> Tensor:
        """Trunk maps of N crops to `[N, embedding, G, G]`."""
        at4, at8, at16 = features
        adapted = self.adapt16(at16)
        wide = nn.functional.interpolate(self.skip16(adapted), scale_factor=2.0, mode="nearest")
        merged = self.merge(torch.cat([self.skip4(at4), self.skip8(at8), wide], dim=1))
        embedding: Tensor = self.norm(self.adapt8(merged))
        return embedding


def sample_region(maps: Tensor, regions: Tensor, cells: int) -> Tensor:
    """Maps resampled over a region each, linearly; averaged where the region is the coarser.

    Two matrix products: every engine has them, and the region's edges lie along the grid's.

    Args:
        maps: `[N, C, G, G]`.
        regions: `[N, 4]`, x1, y1, x2, y2 with the map over 0..1; outside of it there is zero.
        cells: side of the result.

    Returns:
        `[N, C, cells, cells]`.
    """
    side = int(maps.shape[-1])
    centres = torch.arange(0.5, side, dtype=maps.dtype, device=maps.device)
    steps = torch.arange(0.5, cells, dtype=maps.dtype, device=maps.device)[:, None] / cells
    low, high = (regions.reshape(-1, 4, 1, 1) * side).split(2, dim=1)  # [N, x and y, 1, 1]
    extent = high - low
    reach = (extent * (1 / cells)).clamp(min=1.0)
    distance = (low + extent * steps - centres).abs()  # [N, x and y, cells, G]
    across, down = ((reach - distance).clamp(min=0) / (reach * reach)).split(1, dim=1)
    return down @ (maps @ across.transpose(2, 3))


class Correlation(nn.Module):
    """Every template position against every position of the current embedding."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        self.positions = config.template_cells**2
        self.scale = config.embedding**-0.5
        self.reduce = nn.Sequential(
            nn.Conv2d(self.positions, config.correlation, 1), prelu(config, config.correlation)
        )

    def forward(self, template: Tensor, current: Tensor) -> Tensor:
        """`[N, C, K, K]` and `[N, C, G, G]` to `[N, correlation, G, G]`."""
        channels, side = (int(length) for length in current.shape[1:3])
        keys = template.reshape(-1, channels, self.positions).transpose(1, 2)
        maps = current.reshape(-1, channels, side * side)
        values = torch.bmm(keys, maps) * self.scale  # [N, K * K, G * G]
        return self.reduce(values.reshape(-1, self.positions, side, side))
