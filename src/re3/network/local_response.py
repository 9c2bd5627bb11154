"""Local response normalisation in operators that every runtime is quick at."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

EXPONENT = 0.75


class PlainLocalResponse(nn.Module):
    """Computes what `nn.LocalResponseNorm` with an exponent of 3/4 does.

    Traced as it is, torch's becomes pooling over a padded fifth dimension and a power, which ONNX
    Runtime computes one value at a time; sums over neighbouring channels are a 1x1 convolution,
    and a power of 3/4 is two roots.

    Args:
        norm: what it stands for.

    Raises:
        ValueError: another exponent.
    """

    def __init__(self, norm: nn.LocalResponseNorm) -> None:
        super().__init__()
        if norm.beta != EXPONENT:
            raise ValueError(f"the exponent is {norm.beta}; expected {EXPONENT}")
        self._norm = norm

    def forward(self, x: Tensor) -> Tensor:
        # From numpy, so that a tracer sees a constant and not how it came about.
        band = torch.from_numpy(_band(self._norm, int(x.shape[1])))
        root = torch.sqrt(nn.functional.conv2d(x * x, band) + self._norm.k)
        return x / (root * torch.sqrt(root))


def _band(norm: nn.LocalResponseNorm, channels: int) -> NDArray[np.float32]:
    """Weights `[C, C, 1, 1]` that sum the neighbours of each channel, scaled."""
    index = np.arange(channels)
    offset = index[None, :] - index[:, None]
    # Of an even number torch takes one more below than above.
    near = (offset >= -(norm.size // 2)) & (offset <= (norm.size - 1) // 2)
    return (near[:, :, None, None] * (norm.alpha / norm.size)).astype(np.float32)


@contextmanager
def plain_local_response(network: nn.Module) -> Iterator[None]:
    """While the block runs, every such layer of a network computes in the plain way."""
    replaced = [
        (parent, name, child)
        for parent in network.modules()
        for name, child in parent.named_children()
        if isinstance(child, nn.LocalResponseNorm) and child.beta == EXPONENT
    ]
    for parent, name, child in replaced:
        setattr(parent, name, PlainLocalResponse(child))
    try:
        yield
    finally:
        for parent, name, child in replaced:
            setattr(parent, name, child)
