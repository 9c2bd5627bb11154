"""Convolutions trained on ImageNet: CaffeNet and GoogLeNet from Caffe, AlexNet from torchvision.

What a file has beside them, the classifier, is left out. Caffe's first convolutions take BGR; here
crops come to the trunk in RGB.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from re3.network.importers.kinds import Kind, Shape, Tensors, shapes_of
from re3.network.variants import Network


@dataclass(frozen=True)
class Convolution:
    """One convolution of a file.

    Attributes:
        own: its name in a trunk here.
        layer: its name in the file.
        shape: of its weight; its bias has as many values as there are outputs.
    """

    own: str
    layer: str
    shape: Shape


CAFFENET = (
    Convolution("conv.0", "conv1", (96, 3, 11, 11)),
    Convolution("conv.1", "conv2", (256, 48, 5, 5)),
    Convolution("conv.2", "conv3", (384, 256, 3, 3)),
    Convolution("conv.3", "conv4", (384, 192, 3, 3)),
    Convolution("conv.4", "conv5", (256, 192, 3, 3)),
)

ALEXNET = (
    Convolution("conv.0", "features.0", (64, 3, 11, 11)),
    Convolution("conv.1", "features.3", (192, 64, 5, 5)),
    Convolution("conv.2", "features.6", (384, 192, 3, 3)),
    Convolution("conv.3", "features.8", (256, 384, 3, 3)),
    Convolution("conv.4", "features.10", (256, 256, 3, 3)),
)

INCEPTION_INPUTS = 192
INCEPTION_WIDTHS = {
    "3a": (64, 96, 128, 16, 32, 32),
    "3b": (128, 128, 192, 32, 96, 64),
    "4a": (192, 96, 208, 16, 48, 64),
    "4b": (160, 112, 224, 24, 64, 64),
    "4c": (128, 128, 256, 24, 64, 64),
    "4d": (112, 144, 288, 32, 64, 64),
    "4e": (256, 160, 320, 32, 128, 128),
    "5a": (256, 160, 320, 32, 128, 128),
    "5b": (384, 192, 384, 48, 128, 128),
}
"""Channels of 1x1, 3x3 reduce, 3x3, 5x5 reduce, 5x5 and pool projection (Szegedy et al., "Going
Deeper with Convolutions", Table 1)."""


def _googlenet() -> tuple[Convolution, ...]:
    layers = [
        Convolution("conv1", "conv1/7x7_s2", (64, 3, 7, 7)),
        Convolution("conv2_reduce", "conv2/3x3_reduce", (64, 64, 1, 1)),
        Convolution("conv2", "conv2/3x3", (192, 64, 3, 3)),
    ]
    inputs = INCEPTION_INPUTS
    for module, (one, three_reduce, three, five_reduce, five, pool) in INCEPTION_WIDTHS.items():
        layers += [
            Convolution(f"inception.{module}.{own}", f"inception_{module}/{layer}", shape)
            for own, layer, shape in (
                ("one", "1x1", (one, inputs, 1, 1)),
                ("three_reduce", "3x3_reduce", (three_reduce, inputs, 1, 1)),
                ("three", "3x3", (three, three_reduce, 3, 3)),
                ("five_reduce", "5x5_reduce", (five_reduce, inputs, 1, 1)),
                ("five", "5x5", (five, five_reduce, 5, 5)),
                ("pool_proj", "pool_proj", (pool, inputs, 1, 1)),
            )
        ]
        inputs = one + three + five + pool
    return tuple(layers)


GOOGLENET = _googlenet()


def _kind(name: str, variant: str, layers: tuple[Convolution, ...], *, bgr: bool) -> Kind:
    shapes: dict[str, Shape] = {}
    for convolution in layers:
        shapes[f"{convolution.layer}.weight"] = convolution.shape
        shapes[f"{convolution.layer}.bias"] = convolution.shape[:1]

    def convert(tensors: Tensors, _: Network) -> dict[str, Tensor]:
        values = {
            f"{convolution.own}.{part}": tensors[f"{convolution.layer}.{part}"]
            for convolution in layers
            for part in ("weight", "bias")
        }
        if bgr:
            first = f"{layers[0].own}.weight"
            values[first] = values[first].flip(1)
        return values

    return Kind(
        name=name,
        # The last layer tells networks with a like beginning apart.
        marks=(f"{layers[0].layer}.weight", f"{layers[-1].layer}.weight"),
        variant=variant,
        whole=False,
        shapes=lambda _: shapes,
        convert=convert,
    )


KINDS = (
    _kind("CaffeNet (Caffe)", "re3", CAFFENET, bgr=True),
    _kind("GoogLeNet (Caffe)", "paper-K", GOOGLENET, bgr=True),
    _kind("AlexNet (torchvision)", "re3-alexnet", ALEXNET, bgr=False),
)


def fits(values: Tensors, trunk: nn.Module) -> bool:
    """Whether a trunk has all of these weights, in these shapes."""
    own = shapes_of(trunk.state_dict())
    return all(own.get(name) == shape for name, shape in shapes_of(values).items())
