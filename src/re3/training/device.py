"""What training computes on: a CPU or a GPU, in single or in mixed precision."""

from __future__ import annotations

import os
import shutil
from contextlib import AbstractContextManager
from dataclasses import dataclass

import torch
from torch.amp.grad_scaler import GradScaler

KINDS = ("cpu", "cuda")
COMPILERS = ("g++", "clang++", "c++", "cl")
"""Of C++, which torch turns graphs for a CPU into."""


@dataclass(frozen=True)
class Device:
    """A device and its arithmetic.

    Attributes:
        kind: `cpu` or `cuda`.
        index: of the GPU.
        mixed: matrix products and convolutions in 16 bits: float16 with a scaled loss on a GPU,
            bfloat16, which needs no scaling, on a CPU.
        compiled: the pass with gradients is compiled by torch before its first run, which takes a
            minute or two for each length of unroll.

    Raises:
        ValueError: an unknown kind, a GPU that torch does not see, or no compiler.
    """

    kind: str = "cpu"
    index: int = 0
    mixed: bool = False
    compiled: bool = False

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"unknown device {self.kind!r}; expected one of {', '.join(KINDS)}")
        if self.kind == "cuda" and not torch.cuda.is_available():
            raise ValueError(
                f"torch {torch.__version__} sees no GPU here; take --device cpu, or install a "
                "torch built for CUDA"
            )
        if self.compiled and self.kind == "cpu":
            compilers = (os.environ.get("CXX", ""), *COMPILERS)
            if not any(shutil.which(name) for name in compilers):
                raise ValueError(
                    f"compiling needs a C++ compiler, and none of {', '.join(COMPILERS)} is "
                    "installed; install one, name it in CXX, or leave --compile out"
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
