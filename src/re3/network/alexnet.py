"""The paper's network with AlexNet as torchvision has it in place of CaffeNet.

CaffeNet's own weights are hard to come by, torchvision's AlexNet is not. Its maps have the sides of
CaffeNet's after pooling, so that the skips and all that follows stay as they are; its convolutions
have other widths and no groups, and nothing is normalised between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from re3.network.authors import IMAGENET_MEAN, IMAGENET_STD
from re3.network.caffenet import SKIP_CHANNELS, CaffeNet
from re3.network.re3 import Re3, Re3Config


@dataclass(frozen=True)
class AlexNetConfig(Re3Config):
    """The paper's network with torchvision's AlexNet as its convolutions."""

    name: str = "re3-alexnet"


class AlexNet(CaffeNet):
    """torchvision's convolutions in CaffeNet's place; input as they expect it."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.ModuleList(
            [
                nn.Conv2d(3, 64, 11, stride=4, padding=2),
                nn.Conv2d(64, 192, 5, padding=2),
                nn.Conv2d(192, 384, 3, padding=1),
                nn.Conv2d(384, 256, 3, padding=1),
                nn.Conv2d(256, 256, 3, padding=1),
            ]
        )
        skips = [
            nn.Conv2d(inputs, outputs, 1)
            for inputs, outputs in zip((64, 192, 256), SKIP_CHANNELS, strict=True)
        ]
        for skip in skips:
            nn.init.kaiming_normal_(skip.weight)
            if skip.bias is not None:
                nn.init.zeros_(skip.bias)
        self.conv_skip = nn.ModuleList(skips)
        self.std: Tensor
        for name, values in (("mean", IMAGENET_MEAN), ("std", IMAGENET_STD)):
            pixel = 255 * torch.tensor(values)[:, None, None]
            self.register_buffer(name, pixel, persistent=False)

    def forward(self, crops: Tensor) -> Tensor:
        """uint8 `[N, 227, 227, 3]` BGR to `[N, EMBEDDING]`: skip 1, skip 2, skip 5, pool 5."""
        x = (crops.flip(3).permute(0, 3, 1, 2).float() - self.mean) / self.std
        pool1 = self.pool(torch.relu(self.conv[0](x)))
        pool2 = self.pool(torch.relu(self.conv[1](pool1)))
        conv3 = torch.relu(self.conv[2](pool2))
        conv5 = torch.relu(self.conv[4](torch.relu(self.conv[3](conv3))))
        parts = [
            prelu(skip(tap)).flatten(1)
            for prelu, skip, tap in zip(
                self.prelu_skip, self.conv_skip, (pool1, pool2, conv5), strict=True
            )
        ]
        return torch.cat([*parts, self.pool(conv5).flatten(1)], dim=1)


class Re3AlexNet(Re3):
    """See `re3.network.re3.Re3`."""

    def __init__(self, config: AlexNetConfig | None = None) -> None:
        super().__init__(config or AlexNetConfig())
        self.trunk = AlexNet()
