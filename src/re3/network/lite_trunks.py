"""Small pretrained convolutions as the paper's trunk: EfficientNet-Lite0 and AlexNet.

Both have maps at strides 4, 8 and 16. The skip from stride 4 halves its map, the one from stride 8
as well, so that the fully connected layer stays of the size of the LSTM's.
"""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Several

import torch
from torch import Tensor, nn

from re3.network.base import Maps
from re3.network.efficientnet_lite import OUT_CHANNELS, PIXEL_MEAN, EfficientNetLite0
from re3.network.skip_trunk import SkipTrunk, rgb

SKIP_STRIDES = (2, 2, 1)

ALEXNET_MEAN_RGB = (0.485, 0.456, 0.406)
ALEXNET_SCALE_RGB = (0.229, 0.224, 0.225)
"""RGB in 0..1 as torchvision's weights expect it: (pixel - mean) / scale."""

ALEXNET_LAYERS = (0, 3, 6, 8, 10)
"""Places of the convolutions in torchvision's `features`."""


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
        self.mean: Tensor
        self.scale: Tensor
        mean = torch.tensor(ALEXNET_MEAN_RGB)[:, None, None] * 255
        self.register_buffer("mean", mean, persistent=False)
        scale = torch.tensor(ALEXNET_SCALE_RGB)[:, None, None] * 255
        self.register_buffer("scale", scale, persistent=False)

    def maps(self, crops: Tensor) -> Maps:
        """Strides 4, 8, 16 and 32 of uint8 `[N, S, S, 3]` BGR crops."""
        conv1 = torch.relu(self.conv[0]((rgb(crops) - self.mean) / self.scale))
        conv2 = torch.relu(self.conv[1](self.pool(conv1)))
        conv3 = torch.relu(self.conv[2](self.pool(conv2)))
        conv5 = torch.relu(self.conv[4](torch.relu(self.conv[3](conv3))))
        return conv1, conv2, conv5, self.pool(conv5)


def load_alexnet_weights(trunk: AlexNet, weights: Mapping[str, Tensor]) -> None:
    """Fill the convolutions from torchvision's layout (`features.0.weight`, ...).

    Raises:
        KeyError: a weight is missing.
        ValueError: a weight has another shape than the trunk's.
    """
    with torch.no_grad():
        for layer, conv in zip(ALEXNET_LAYERS, trunk.conv, strict=True):
            for name, own in conv.named_parameters():
                given = weights[f"features.{layer}.{name}"]
                if given.shape != own.shape:
                    raise ValueError(
                        f"weight features.{layer}.{name} has shape {tuple(given.shape)}; "
                        f"expected {tuple(own.shape)} as in torchvision's AlexNet"
                    )
                own.copy_(given)
