"""What a network costs: parameters, and arithmetic for one step of one object."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch.utils.flop_counter import FlopCounterMode

from re3.network.variants import Config, build


@dataclass(frozen=True)
class Cost:
    """Costs of a network.

    Attributes:
        parameters: number of learnt values.
        flops: operations of a step of one object, in convolutions and matrix products; a
            multiplication and an addition are two.
    """

    parameters: int
    flops: int


def cost(config: str | Config) -> Cost:
    """The costs of a network, by a name in `VARIANTS` or a configuration; nothing is computed."""
    with torch.device("meta"):
        network = build(config).eval()
        spec = network.spec()
        crops = [
            torch.zeros(1, crop.size, crop.size, 3, dtype=torch.uint8)
            for crop in (spec.previous, spec.current)
            if crop is not None
        ]
        with FlopCounterMode(display=False) as counter, torch.no_grad():
            network(*crops, network.zero_state(1, "meta"))
    return Cost(sum(p.numel() for p in network.parameters()), counter.get_total_flops())
