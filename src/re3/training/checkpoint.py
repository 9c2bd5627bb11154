"""Checkpoints: written whole or not at all, whatever kills the process meanwhile."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import torch

PARTIAL = ".partial"


def save_whole(values: dict[str, Any], path: Path) -> None:
    """Write a file such that it is there complete or not at all, or still what it was."""
    partial = path.with_name(f"{path.name}.{os.getpid()}{PARTIAL}")
    with partial.open("wb") as file:
        torch.save(values, file)
        # On disk before it takes the name: a power cut must not leave an empty checkpoint.
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def load(path: Path, device: str = "cpu") -> dict[str, Any]:
    """What `save_whole` wrote; runs no code that a file might carry.

    Raises:
        OSError: the file cannot be read.
        Whatever `torch.load` raises for a file that is none of its own.
    """
    values: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
    return values


def remove_partial(folder: Path) -> None:
    """Remove what a killed process left half written."""
    for path in folder.glob(f"*{PARTIAL}"):
        path.unlink(missing_ok=True)
