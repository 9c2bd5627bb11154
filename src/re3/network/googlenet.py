"""GoogLeNet's convolutions, Inception v1, with skip connections (Re3, Table I, model K).

Architecture: Szegedy et al., "Going Deeper with Convolutions" (2015), without the classifiers, as
Caffe has it: pooling rounds sizes up, response normalisation about the second convolution. The
paper does not say where its skip connections start. Here it is where the resolution falls, as in
CaffeNet: after pool2, pool3, and from the end of stage 4, which has the resolution of pool3.
"""

from __future__ import annotations

from collections.abc import Sequence as Several
from typing import NamedTuple

import torch
from torch import Tensor, nn

from re3.network.base import Maps
from re3.network.pixels import rgb
from re3.network.skip_trunk import SkipTrunk

PIXEL_MEAN_RGB = (123.0, 117.0, 104.0)
"""Subtracted from RGB in 0..255; there is no division."""

SKIP_CHANNELS = (16, 32, 64)
"""Of the skip connections after pool2, pool3 and inception_4e."""


class Widths(NamedTuple):
    """Channels of an inception module."""

    one: int
    three_reduce: int
    three: int
    five_reduce: int
    five: int
    pool: int

    @property
    def outputs(self) -> int:
        return self.one + self.three + self.five + self.pool


MODULES = {
    "3a": Widths(64, 96, 128, 16, 32, 32),
    "3b": Widths(128, 128, 192, 32, 96, 64),
    "4a": Widths(192, 96, 208, 16, 48, 64),
    "4b": Widths(160, 112, 224, 24, 64, 64),
    "4c": Widths(128, 128, 256, 24, 64, 64),
    "4d": Widths(112, 144, 288, 32, 64, 64),
    "4e": Widths(256, 160, 320, 32, 128, 128),
    "5a": Widths(256, 160, 320, 32, 128, 128),
    "5b": Widths(384, 192, 384, 48, 128, 128),
}
"""Name -> channels (Table 1 of the GoogLeNet paper)."""


class Inception(nn.Module):
    """Convolutions 1x1, 3x3 and 5x5 and a pooling, side by side; all with ReLU."""

    def __init__(self, inputs: int, widths: Widths) -> None:
        super().__init__()
        self.one = nn.Conv2d(inputs, widths.one, 1)
        self.three_reduce = nn.Conv2d(inputs, widths.three_reduce, 1)
        self.three = nn.Conv2d(widths.three_reduce, widths.three, 3, padding=1)
        self.five_reduce = nn.Conv2d(inputs, widths.five_reduce, 1)
        self.five = nn.Conv2d(widths.five_reduce, widths.five, 5, padding=2)
        self.pool_proj = nn.Conv2d(inputs, widths.pool, 1)
        self.pool = nn.MaxPool2d(3, stride=1, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        branches = (
            self.one(x),
            self.three(torch.relu(self.three_reduce(x))),
            self.five(torch.relu(self.five_reduce(x))),
            self.pool_proj(self.pool(x)),
        )
        return torch.relu(torch.cat(branches, dim=1))


class GoogLeNet(SkipTrunk):
    """Inception v1 up to its average pooling.

    Args:
        skips: channels of the skip connections; none without.
    """

    def __init__(self, skips: Several[int] = SKIP_CHANNELS) -> None:
        super().__init__((192, MODULES["3b"].outputs, MODULES["4e"].outputs), skips, (1, 1, 1))
        self.conv1 = nn.Conv2d(3, 64, 7, stride=2, padding=3)
        self.conv2_reduce = nn.Conv2d(64, 64, 1)
        self.conv2 = nn.Conv2d(64, 192, 3, padding=1)
        channels = 192
        self.inception = nn.ModuleDict()
        for name, widths in MODULES.items():
            self.inception[name] = Inception(channels, widths)
            channels = widths.outputs
        self.pool = nn.MaxPool2d(3, stride=2, ceil_mode=True)
        self.norm = nn.LocalResponseNorm(5, alpha=1e-4, beta=0.75, k=1.0)
        self.mean: Tensor
        mean = torch.tensor(PIXEL_MEAN_RGB)[:, None, None]
        self.register_buffer("mean", mean, persistent=False)

    def maps(self, crops: Tensor) -> Maps:
        """pool2, pool3, inception_4e and pool5 of uint8 `[N, S, S, 3]` BGR crops."""
        norm1 = self.norm(self.pool(torch.relu(self.conv1(rgb(crops) - self.mean))))
        conv2 = torch.relu(self.conv2(torch.relu(self.conv2_reduce(norm1))))
        pool2 = self.pool(self.norm(conv2))
        pool3 = self.pool(self._run(pool2, "3a", "3b"))
        end4 = self._run(pool3, "4a", "4b", "4c", "4d", "4e")
        end5 = self._run(self.pool(end4), "5a", "5b")
        return pool2, pool3, end4, end5.mean(dim=(2, 3), keepdim=True)

    def _run(self, x: Tensor, *names: str) -> Tensor:
        for name in names:
            x = self.inception[name](x)
        return x
