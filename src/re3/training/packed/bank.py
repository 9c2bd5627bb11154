"""All pictures of the training data on one device, each at several resolutions."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray

LEVELS = 4
"""Resolutions of each picture: full, half, quarter and eighth."""
ALIGNMENT = 64
"""Pixels that the start of every picture is a multiple of."""


class ImageBank:
    """Pictures of any sizes in one tensor.

    A pixel is one int32: blue, green, red and, in the highest byte, the number of the object that
    it shows; so that one read brings all of it.

    Args:
        sizes: int `[I, 2]`, width and height of each picture in pixels.
        device: where they are kept.

    Attributes:
        pixels: int32 `[P]`, all levels of all pictures.
        offsets: int64 `[I, LEVELS]`, the first pixel of each level.
        sizes: int64 `[I, LEVELS, 2]`, width and height of each level.
    """

    def __init__(self, sizes: NDArray[np.int64], device: torch.device) -> None:
        levels = [np.asarray(sizes, dtype=np.int64).reshape(-1, 2)]
        for _ in range(LEVELS - 1):
            levels.append(-(-levels[-1] // 2))
        by_level = np.stack(levels, axis=1)  # [I, LEVELS, 2]
        counts = by_level.prod(axis=2).reshape(-1)
        counts = -(-counts // ALIGNMENT) * ALIGNMENT
        ends = np.cumsum(counts)
        self.pixels = torch.zeros(int(ends[-1]), dtype=torch.int32, device=device)
        self._host_offsets = (ends - counts).reshape(-1, LEVELS)
        self._host_sizes = by_level
        self.offsets = torch.from_numpy(self._host_offsets).to(device)
        self.sizes = torch.from_numpy(by_level).to(device)

    def put(self, first: int, frames: NDArray[np.uint8], numbers: NDArray[np.uint8] | None) -> None:
        """Store pictures of one size.

        Args:
            first: index of the first of them; the others follow it.
            frames: uint8 `[T, H, W, 3]` RGB.
            numbers: uint8 `[H, W]`, of the objects of a single picture; None for no objects.

        Raises:
            ValueError: they are not of the size that was announced.
        """
        height, width = frames.shape[1:3]
        expected = self._host_sizes[first, 0].tolist()
        if [width, height] != expected:
            raise ValueError(
                f"picture {first} has {width} x {height} pixels; expected "
                f"{expected[0]} x {expected[1]}"
            )
        device = self.pixels.device
        # One copy to the device; flipping to BGR there.
        rgb = torch.from_numpy(np.require(frames, requirements=["C", "W"])).to(device)
        level = rgb.flip(-1).permute(0, 3, 1, 2).float()
        labels = torch.zeros(len(frames), height, width, dtype=torch.uint8, device=device)
        if numbers is not None:
            labels[:] = torch.from_numpy(np.require(numbers, requirements=["C", "W"])).to(device)
        for index in range(LEVELS):
            packed = torch.cat(
                [level.round().to(torch.uint8).permute(0, 2, 3, 1), labels[..., None]], dim=-1
            )
            values = packed.contiguous().view(torch.int32).reshape(len(frames), -1)
            for frame, row in enumerate(values):
                start = int(self._host_offsets[first + frame, index])
                self.pixels[start : start + row.numel()] = row
            level = F.avg_pool2d(level, 2, ceil_mode=True, count_include_pad=False)
            labels = labels[:, ::2, ::2]

    def gigabytes(self) -> float:
        """Memory that the pictures take."""
        return self.pixels.numel() * self.pixels.element_size() / 1e9


def fill_bank(
    sizes: NDArray[np.int64],
    pictures: Iterable[tuple[int, NDArray[np.uint8], NDArray[np.uint8] | None]],
    device: torch.device,
    report: Callable[[int], None] = lambda done: None,
) -> ImageBank:
    """A bank of all pictures.

    Args:
        sizes: see `ImageBank`.
        pictures: index of the first, the frames and their object numbers; see `ImageBank.put`.
        device: where they are kept.
        report: called with the number of pictures stored so far.
    """
    bank = ImageBank(sizes, device)
    done = 0
    for first, frames, numbers in pictures:
        bank.put(first, frames, numbers)
        done += len(frames)
        report(done)
    return bank
