"""What training computes on: a CPU or a GPU, in single or in mixed precision."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass

import torch
from torch.amp.grad_scaler import GradScaler

KINDS = ("cpu", "cuda")


@dataclass(frozen=True)
class Device:
    """A device and its arithmetic.

    Attributes:
        kind: `cpu` or `cuda`.
        index: of the GPU.
        mixed: matrix products and convolutions in 16 bits: float16 with a scaled loss on a GPU,
            bfloat16, which needs no scaling, on a CPU.

    Raises:
        ValueError: an unknown kind, or a GPU that torch does not see.
    """

    kind: str = "cpu"
    index: int = 0
    mixed: bool = False

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"unknown device {self.kind!r}; expected one of {', '.join(KINDS)}")
        if self.kind == "cuda" and not torch.cuda.is_available():
            raise ValueError(
                f"torch {torch.__version__} sees no GPU here; take --device cpu, or install a "
                "torch built for CUDA"
            )

    @property
    def torch(self) -> torch.device:
        """As torch names it."""
        return torch.device(self.kind, self.index) if self.kind == "cuda" else torch.device("cpu")

    def autocast(self) -> AbstractContextManager[None]:
        """Mixed precision for what runs inside, where it is asked for."""
        dtype = torch.float16 if self.kind == "cuda" else torch.bfloat16
        return torch.autocast(self.kind, dtype=dtype, enabled=self.mixed)

    def scaler(self) -> GradScaler:
        """Keeps float16 gradients from vanishing; does nothing elsewhere."""
        return GradScaler(self.kind, enabled=self.mixed and self.kind == "cuda")
