"""Annotated clips and their readers."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from re3.data.plain import read_folder, read_track, read_tracks
    from re3.data.sequence import Sequence

__all__ = ["Sequence", "read_folder", "read_track", "read_tracks"]


def __getattr__(name: str) -> Any:
    # Late: packed training data is read where there is no video decoder.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = "re3.data.sequence" if name == "Sequence" else "re3.data.plain"
    return getattr(import_module(module), name)
