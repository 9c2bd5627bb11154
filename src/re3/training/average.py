"""The average of the weights over the last iterations, which is what is validated and exported."""

from __future__ import annotations

import torch
from torch import nn


def update_average(average: nn.Module, network: nn.Module, decay: float, iteration: int) -> None:
    """Move the average towards the network as it is now.

    Args:
        average: a copy of the network, changed in place.
        network: whose parameters that need gradients are averaged.
        decay: share of the average that stays; early on less, or it would remember the
            initialisation.
        iteration: how many were done before.
    """
    decay = min(decay, (1 + iteration) / (10 + iteration))
    with torch.no_grad():
        for mean, value in zip(average.parameters(), network.parameters(), strict=True):
            if value.requires_grad:
                mean.lerp_(value, 1 - decay)
