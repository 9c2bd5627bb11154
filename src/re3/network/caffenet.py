"""CaffeNet's convolutions with the paper's skip connections (Re3, sec. III-A and III-C)."""

from __future__ import annotations

from collections.abc import Sequence as Several

import torch
from torch import Tensor, nn

from re3.network.base import Maps
from re3.network.pixels import rgb
from re3.network.skip_trunk import SkipTrunk

PIXEL_MEAN_RGB = (123.151630838, 115.902882574, 103.062623801)
"""Subtracted from RGB in 0..255; there is no division."""

SKIP_CHANNELS = (16, 32, 64)
"""Of the skip connections after norm1, norm2 and conv5."""

CROP_SIZE = 227
EMBEDDING = 27 * 27 * 16 + 13 * 13 * 32 + 13 * 13 * 64 + 6 * 6 * 256
"""Values per crop of 227 pixels: the three skips and pool5, each flattened."""


class CaffeNet(SkipTrunk):
    """AlexNet in Caffe's order (pooling before normalisation), two groups in conv 2, 4 and 5.

    Every skip is a 1x1 convolution and a PReLU; the channels double as the resolution halves.

    Args:
        skips: channels of the skip connections; none without.
    """

    def __init__(self, skips: Several[int] = SKIP_CHANNELS) -> None:
        super().__init__((96, 256, 256), skips, (1, 1, 1))
        self.conv = nn.ModuleList(
            [
                nn.Conv2d(3, 96, 11, stride=4),
                nn.Conv2d(96, 256, 5, padding=2, groups=2),
                nn.Conv2d(256, 384, 3, padding=1),
                nn.Conv2d(384, 384, 3, padding=1, groups=2),
                nn.Conv2d(384, 256, 3, padding=1, groups=2),
            ]
        )
        self.pool = nn.MaxPool2d(3, stride=2)
        self.norm = nn.LocalResponseNorm(5, alpha=1e-4, beta=0.75, k=1.0)
        self.mean: Tensor
        mean = torch.tensor(PIXEL_MEAN_RGB)[:, None, None]
        self.register_buffer("mean", mean, persistent=False)

    def maps(self, crops: Tensor) -> Maps:
        """norm1, norm2, conv5 and pool5 of uint8 `[N, S, S, 3]` BGR crops."""
        x = rgb(crops) - self.mean
        norm1 = self.norm(torch.relu(self.pool(self.conv[0](x))))
        norm2 = self.norm(torch.relu(self.pool(self.conv[1](norm1))))
        conv3 = torch.relu(self.conv[2](norm2))
        conv4 = torch.relu(self.conv[3](conv3))
        conv5 = torch.relu(self.conv[4](conv4))
        return norm1, norm2, conv5, self.pool(conv5)
