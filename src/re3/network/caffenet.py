"""CaffeNet's convolutions with the paper's skip connections (Re3, sec. III-A and III-C)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

PIXEL_MEAN_RGB = (123.151630838, 115.902882574, 103.062623801)
"""Subtracted from RGB in 0..255; there is no division."""

SKIP_CHANNELS = (16, 32, 64)
"""Of the skip connections after norm1, norm2 and conv5."""

CROP_SIZE = 227
EMBEDDING = 27 * 27 * 16 + 13 * 13 * 32 + 13 * 13 * 64 + 6 * 6 * 256
"""Values per crop of 227 pixels: the three skips and pool5, each flattened."""


class CaffeNet(nn.Module):
    """AlexNet in Caffe's order (pooling before normalisation), two groups in conv 2, 4 and 5.

    Every skip is a 1x1 convolution and a PReLU; the channels double as the resolution halves.
    """

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.ModuleList(
            [
                nn.Conv2d(3, 96, 11, stride=4),
                nn.Conv2d(96, 256, 5, padding=2, groups=2),
                nn.Conv2d(256, 384, 3, padding=1),
                nn.Conv2d(384, 384, 3, padding=1, groups=2),
                nn.Conv2d(384, 256, 3, padding=1, groups=2),
            ]
        )
        self.conv_skip = nn.ModuleList(
            [
                nn.Conv2d(inputs, outputs, 1)
                for inputs, outputs in zip((96, 256, 256), SKIP_CHANNELS, strict=True)
            ]
        )
        self.prelu_skip = nn.ModuleList([nn.PReLU(channels) for channels in SKIP_CHANNELS])
        self.pool = nn.MaxPool2d(3, stride=2)
        self.norm = nn.LocalResponseNorm(5, alpha=1e-4, beta=0.75, k=1.0)
        self.mean: Tensor
        mean = torch.tensor(PIXEL_MEAN_RGB)[:, None, None]
        self.register_buffer("mean", mean, persistent=False)

    def forward(self, crops: Tensor) -> Tensor:
        """uint8 `[N, 227, 227, 3]` BGR to `[N, EMBEDDING]`: skip 1, skip 2, skip 5, pool 5."""
        x = crops.flip(3).permute(0, 3, 1, 2).float() - self.mean
        norm1 = self.norm(torch.relu(self.pool(self.conv[0](x))))
        norm2 = self.norm(torch.relu(self.pool(self.conv[1](norm1))))
        conv3 = torch.relu(self.conv[2](norm2))
        conv4 = torch.relu(self.conv[3](conv3))
        conv5 = torch.relu(self.conv[4](conv4))
        parts = [
            prelu(skip(tap)).flatten(1)
            for prelu, skip, tap in zip(
                self.prelu_skip, self.conv_skip, (norm1, norm2, conv5), strict=True
            )
        ]
        return torch.cat([*parts, self.pool(conv5).flatten(1)], dim=1)
