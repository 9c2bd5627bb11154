"""Small pretrained convolutions as the paper's trunk: EfficientNet-Lite0 and AlexNet.

Both have maps at strides 4, 8 and 16. The skip from stride 4 halves its map, the one from stride 8
as well, so that the fully connected layer stays of the size of the LSTM's.
"""

from __future__ import annotations

from collections.abc import Sequence as Several

import torch
from torch import Tensor, nn

from re3.network.base import Maps
from re3.network.efficientnet_lite import OUT_CHANNELS, PIXEL_MEAN, EfficientNetLite0
from re3.network.pixels import Standardise
from re3.network.skip_trunk import SkipTrunk

SKIP_STRIDES = (2, 2, 1)


class LiteTrunk(SkipTrunk):
    """EfficientNet-Lite0 up to stride 16; the last map is pooled to half its side.

    Args:
        skips: channels of the skip connections from strides 4, 8 and 16; none without.
    """

    def __init__(self, skips: Several[int] = ()) -> None:
        super().__init__(tuple(OUT_CHANNELS.values()), skips, SKIP_STRIDES)
        self.convolutions = EfficientNetLite0()

    def maps(self, crops: Tensor) -> Maps:
        """Strides 4, 8, 16 and 32 of uint8 `[N, S, S, 3]` BGR crops; S a multiple of 16."""
        maps = self.convolutions(crops.permute(0, 3, 1, 2).float() - PIXEL_MEAN)
        return *maps, nn.functional.max_pool2d(maps[-1], 2)


class AlexNet(SkipTrunk):
    """torchvision's AlexNet: 64 to 256 channels, neither groups nor response normalisation.

    Args:
        skips: channels of the skip connections from strides 4, 8 and 16; none without.
    """

    def __init__(self, skips: Several[int] = ()) -> None:
        super().__init__((64, 192, 256), skips, SKIP_STRIDES)
        self.conv = nn.ModuleList(
            [
                nn.Conv2d(3, 64, 11, stride=4, padding=2),
                nn.Conv2d(64, 192, 5, padding=2),
                nn.Conv2d(192, 384, 3, padding=1),
                nn.Conv2d(384, 256, 3, padding=1),
                nn.Conv2d(256, 256, 3, padding=1),
            ]
        )
        self.pool = nn.MaxPool2d(3, stride=2)
        self.standardise = Standardise()

    def maps(self, crops: Tensor) -> Maps:
        """Strides 4, 8, 16 and 32 of uint8 `[N, S, S, 3]` BGR crops."""
        conv1 = torch.relu(self.conv[0](self.standardise(crops)))
        conv2 = torch.relu(self.conv[1](self.pool(conv1)))
        conv3 = torch.relu(self.conv[2](self.pool(conv2)))
        conv5 = torch.relu(self.conv[4](torch.relu(self.conv[3](conv3))))
        return conv1, conv2, conv5, self.pool(conv5)
