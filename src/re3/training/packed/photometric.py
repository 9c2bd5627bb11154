"""What a camera does to crops: blur, contrast, noise and compression, on the device in batches."""

from __future__ import annotations

from functools import lru_cache

import torch
import torch.nn.functional as F
from torch import Tensor

from re3.training.packed.clips import ClipBatch

BLOCK = 8
"""Side of the blocks that JPEG compresses, in pixels."""
LUMINANCE_TABLE = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
"""Quantisation of JPEG at quality 50 (ITU-T T.81, annex K.1); used for all three channels here."""


def take_picture(crops: Tensor, clips: ClipBatch, frame: int, generator: torch.Generator) -> Tensor:
    """Crops as the cameras of their clips see them.

    Args:
        crops: float32 `[N, S, S, 3]` BGR, 0 to 255; S a multiple of 8.
        clips: whose camera effects are applied.
        frame: of the clips.
        generator: of the sensors' noise, on the device of the crops.

    Returns:
        the same shape, whole numbers from 0 to 255.
    """
    luminance = 0.114 * crops[..., 0] + 0.587 * crops[..., 1] + 0.299 * crops[..., 2]
    crops = torch.where(clips.grey[:, None, None, None], luminance[..., None], crops)
    crops = blur(crops, clips.blurred[frame], clips.kernels[frame])
    gain, offset = clips.gain[frame][:, None, None, :], clips.offset[frame][:, None, None, None]
    crops = ((crops - 127.0) * gain + 127.0 + offset).clamp(0, 255)
    grain = torch.randn(crops.shape[:3], generator=generator, device=crops.device)
    crops = crops + (grain * clips.noise[:, None, None])[..., None]
    crops = compress(crops.clamp(0, 255), clips.compressed, clips.quality)
    return crops.round().clamp(0, 255)


def blur(crops: Tensor, which: Tensor, kernels: Tensor) -> Tensor:
    """Some of the crops convolved with a kernel each.

    Args:
        crops: `[N, S, S, 3]`.
        which: int64 `[B]`, each crop at most once.
        kernels: `[B, K, K]`, K odd.
    """
    if not len(which):
        return crops
    side, reach = crops.shape[1], kernels.shape[-1] // 2
    chosen = crops[which].permute(0, 3, 1, 2).reshape(1, -1, side, side)
    padded = F.pad(chosen, [reach] * 4, mode="replicate")
    weights = kernels[:, None].repeat_interleave(3, dim=0)  # [3 B, 1, K, K]
    blurred = F.conv2d(padded, weights, groups=len(weights))
    blurred = blurred.reshape(-1, 3, side, side).permute(0, 2, 3, 1)
    return crops.index_copy(0, which, blurred.to(crops.dtype))


def compress(crops: Tensor, which: Tensor, quality: Tensor) -> Tensor:
    """Some of the crops as JPEG shows them: the cosine transform of each block quantised.

    Args:
        crops: `[N, S, S, 3]` BGR.
        which: int64 `[C]`, each crop at most once.
        quality: `[C]`, 1 to 100; from 100 on nothing is quantised.
    """
    if not len(which):
        return crops
    chosen, side = crops[which], crops.shape[1]
    to_ycc, to_bgr, cosine, tables = _constants(crops.device)
    ycc = chosen @ to_ycc  # BGR to luminance, blue and red difference
    cells = side // BLOCK
    blocks = ycc.reshape(-1, cells, BLOCK, cells, BLOCK, 3).permute(0, 1, 3, 5, 2, 4)
    frequencies = cosine @ (blocks - 128.0) @ cosine.T
    scale = torch.where(quality < 50, 50.0 / quality, 2.0 - quality / 50.0).clamp(min=0.02)
    table = tables * scale[:, None, None]
    table = table[:, None, None, None].clamp(min=1.0)
    quantised = (frequencies / table).round() * table
    restored = (cosine.T @ quantised @ cosine + 128.0).permute(0, 1, 4, 2, 5, 3)
    restored = restored.reshape(chosen.shape) @ to_bgr
    kept = (quality >= 100)[:, None, None, None]
    return crops.index_copy(0, which, torch.where(kept, chosen, restored.clamp(0, 255)))


@lru_cache
def _constants(device: torch.device) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """BGR to luminance and colour differences and back, `[3, 3]` each; the orthonormal cosine
    transform, `[8, 8]`, frequencies by positions; the quantisation table `[8, 8]`.

    Made once for each device: nothing may be copied to it while a CUDA graph is recorded.
    """
    to_ycc = torch.tensor(
        [[0.114, 0.5, -0.081312], [0.587, -0.331264, -0.418688], [0.299, -0.168736, 0.5]]
    )
    steps = torch.arange(BLOCK, dtype=torch.float32)
    basis = torch.cos((2 * steps[None, :] + 1) * steps[:, None] * torch.pi / (2 * BLOCK))
    basis = basis * (2.0 / BLOCK) ** 0.5
    basis[0] = basis[0] / 2.0**0.5
    table = torch.tensor(LUMINANCE_TABLE, dtype=torch.float32)
    made = (to_ycc, torch.linalg.inv(to_ycc), basis, table)
    return tuple(one.to(device) for one in made)  # type: ignore[return-value]
