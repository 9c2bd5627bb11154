"""What a batch of clips shows: layers of pictures on affine paths, boxes, and camera effects.

Recorded and simulated clips are described alike. A recorded clip has one layer, whose picture is
another frame in every step; a simulated one has a background, companions, the object and
occluders (Re3, sec. III-C).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor

BACKGROUND, TWIN, OTHER, TARGET = 0, 1, 2, 3
"""Layers by depth; those after the target are occluders."""
OCCLUDERS = 2
LAYERS = TARGET + 1 + OCCLUDERS
BENDING_MODES = 2

ABSENT, WHOLE, RECTANGLE, ELLIPSE, NUMBERED = 0, 1, 2, 3, 4
"""What is opaque of a layer's picture: nothing, all (reflected at its borders), its rectangle, the
ellipse in that, or the pixels of the object with its number."""


@dataclass(frozen=True, eq=False)
class ClipBatch:
    """N clips of T frames with up to L = `LAYERS` layers, M = `BENDING_MODES`.

    Coordinates are at pixel corners: of pictures at full resolution, of scenes, and of crops.

    Attributes:
        image: int64 `[T, N, L]`, index into the image bank.
        to_picture: float32 `[T, N, L, 2, 3]`, scene to picture.
        rectangle: float32 `[N, L, 4]`, of the object in its picture, xyxy.
        opaque: int64 `[N, L]`, one of the constants of this module.
        shown: bool `[T, N, L]`, False where a layer is not there.
        number: int64 `[N, L]`, of the object in its picture.
        bend_amplitude: float32 `[T, N, L, M, 2]`, displacement in shares of the rectangle's size.
        bend_frequency, bend_phase: float32 `[N, L, M, 2]`, waves across the rectangle; radians.
        size: float32 `[N, 2]`, width and height of the scene; outside there is `fill`.
        boxes_xyxy: float32 `[T, N, 4]`, NaN where the object is absent.
        leaps: bool `[N]`, the first frame lies a temporal gap apart from the others.
        source: int64 `[N]`, of the clip: index into the sources.
        gain: float32 `[T, N, 3]` and offset `[T, N]`, contrast of each channel about middle grey,
            and brightness.
        grey: bool `[N]`, shown without colour.
        noise: float32 `[N]`, standard deviation of the sensor's noise.
        blurred: int64 `[T, B]`, which clips are blurred, each at most once.
        kernels: float32 `[T, B, K, K]`, their blur.
        compressed: int64 `[C]`, which clips are compressed, each at most once.
        quality: float32 `[C]`, of that, as of JPEG; 100 or more leaves them as they are.
    """

    image: Tensor
    to_picture: Tensor
    rectangle: Tensor
    opaque: Tensor
    shown: Tensor
    number: Tensor
    bend_amplitude: Tensor
    bend_frequency: Tensor
    bend_phase: Tensor
    size: Tensor
    boxes_xyxy: Tensor
    leaps: Tensor
    source: Tensor
    gain: Tensor
    offset: Tensor
    grey: Tensor
    noise: Tensor
    blurred: Tensor
    kernels: Tensor
    compressed: Tensor
    quality: Tensor

    def to(self, device: torch.device) -> ClipBatch:
        """The same on a device; pinned memory is copied while the host goes on."""
        return ClipBatch(
            **{f.name: getattr(self, f.name).to(device, non_blocking=True) for f in fields(self)}
        )

    def pin_memory(self) -> ClipBatch:
        """The same in pinned memory, as `torch.utils.data.DataLoader` asks for it."""
        return ClipBatch(**{f.name: getattr(self, f.name).pin_memory() for f in fields(self)})

    @property
    def clips(self) -> int:
        return int(self.boxes_xyxy.shape[1])

    @property
    def frames(self) -> int:
        return int(self.boxes_xyxy.shape[0])
