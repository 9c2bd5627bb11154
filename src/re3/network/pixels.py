"""Pixels as networks pretrained on ImageNet expect them."""

from __future__ import annotations

import torch
from torch import Tensor, nn

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
"""Of RGB in 0..1."""


def rgb(crops: Tensor) -> Tensor:
    """uint8 `[N, S, S, 3]` BGR to float `[N, 3, S, S]` RGB in 0..255."""
    # Planes first: ONNX Runtime turns whole planes round in no time, pixels one by one.
    return crops.permute(0, 3, 1, 2).flip(1).float()


class Standardise(nn.Module):
    """uint8 `[N, S, S, 3]` BGR to float `[N, 3, S, S]` RGB of mean 0 and deviation 1."""

    def __init__(self) -> None:
        super().__init__()
        self.mean: Tensor
        self.std: Tensor
        for name, values in (("mean", IMAGENET_MEAN), ("std", IMAGENET_STD)):
            pixel = 255 * torch.tensor(values)[:, None, None]
            self.register_buffer(name, pixel, persistent=False)

    def forward(self, crops: Tensor) -> Tensor:
        return (rgb(crops) - self.mean) / self.std
