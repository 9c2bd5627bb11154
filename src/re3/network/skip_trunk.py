"""Convolutions with skip connections, the part that all of the paper's trunks share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence as Several

import torch
from torch import Tensor, nn

from re3.network.base import Maps


class SkipTrunk(nn.Module, ABC):
    """Convolutions whose last map, and maps of early layers, make the embedding of a crop.

    Every skip is a 1x1 convolution and a PReLU, of few channels where the resolution is high, more
    where it is low (Re3, sec. III-A). Without skips there is the last map alone.

    Args:
        inputs: channels of the maps that skips start from, early ones first.
        skips: channels of the skips, as many; none for a trunk without.
        strides: of the skips' convolutions, which are as wide: above 1 where a map has more
            positions than a fully connected layer can take.
    """

    def __init__(self, inputs: Several[int], skips: Several[int], strides: Several[int]) -> None:
        super().__init__()
        if skips and len(skips) != len(inputs):
            raise ValueError(
                f"skips is {tuple(skips)}; expected channels for {len(inputs)} skips, or none"
            )
        used = zip(inputs, skips, strides, strict=True) if skips else ()
        self.conv_skip = nn.ModuleList(
            [nn.Conv2d(given, kept, stride, stride) for given, kept, stride in used]
        )
        self.prelu_skip = nn.ModuleList([nn.PReLU(channels) for channels in skips])

    @abstractmethod
    def maps(self, crops: Tensor) -> Maps:
        """The maps that skips start from, of uint8 `[N, S, S, 3]` BGR crops, and the last map."""

    def last(self, maps: Tensor) -> Tensor:
        """The last map as it goes into the embedding."""
        return maps

    def taps(self, crops: Tensor) -> Maps:
        """All that `embed` needs of uint8 `[N, S, S, 3]` BGR crops, without the skips' weights."""
        maps = self.maps(crops)
        return maps if len(self.conv_skip) else maps[-1:]

    def embed(self, taps: Maps) -> Tensor:
        """Taps of N crops to `[N, E]`: the skips and the last map, each flattened."""
        parts = [
            prelu(skip(tap)).flatten(1)
            for prelu, skip, tap in zip(self.prelu_skip, self.conv_skip, taps[:-1], strict=True)
        ]
        return torch.cat([*parts, self.last(taps[-1]).flatten(1)], dim=1)

    def forward(self, crops: Tensor) -> Tensor:
        """The embedding `[N, E]` of uint8 `[N, S, S, 3]` BGR crops."""
        return self.embed(self.taps(crops))

    def embedding(self, size: int) -> int:
        """Values per crop of so many pixels."""
        training = self.training
        self.eval()  # or batch normalisation would take note of an empty crop
        with torch.no_grad():
            values = self(torch.zeros(1, size, size, 3, dtype=torch.uint8)).shape[1]
        self.train(training)
        return int(values)
