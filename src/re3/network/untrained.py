"""Networks with random weights that behave as trained ones do, to measure speed and rounding on."""

from __future__ import annotations

import torch

from re3.network.re3 import Re3
from re3.network.variants import Network, build


def build_untrained(variant: str, seed: int = 0) -> Network:
    """A network with random weights, the same for the same seed.

    Fresh weights of the paper's network give values of about 30 after the fully connected layer,
    since crops come in as 0 to 255: every gate of the LSTM is then wide open or shut, and what is
    rounded off before decides which. There, that layer is scaled to values of about 1, and the
    readout is moved so that the object seems to rest.

    Args:
        variant: a name in `re3.network.variants.VARIANTS`.

    Raises:
        ValueError: unknown name.
    """
    generator_state = torch.random.get_rng_state()
    try:
        torch.manual_seed(seed)
        network = build(variant)
        if isinstance(network, Re3):
            _calm(network)
        return network
    finally:
        torch.random.set_rng_state(generator_state)


def _calm(network: Re3) -> None:
    view = network.config.crop
    crops = torch.randint(0, 256, (2, view.size, view.size, 3), dtype=torch.uint8)
    with torch.no_grad():
        both = torch.cat([network.trunk(crops), network.trunk(crops.flip(0))], dim=1)
        values = network.fully_connected(both)
        network.fully_connected.weight /= values.square().mean().sqrt()
        # Corners of an object that has not moved, in the middle of a crop twice its size.
        low, high = (1 - 1 / view.context) / 2, (1 + 1 / view.context) / 2
        scale = network.spec().regression_scale
        network.corners.bias.copy_(torch.tensor([low, low, high, high]) * scale)
