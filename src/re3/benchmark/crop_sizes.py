"""`re3-lite` with other crops, for their speed: their weights are untrained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from re3.benchmark.contenders import Entry


def write_sized(sizes: Sequence[int], folder: Path, threads: int = 0) -> dict[int, Entry]:
    """Write a network for each side of the crop, as the shipped one's layers fit only its own.

    Args:
        sizes: sides in pixels, multiples of 48 from 96 on.
        folder: for the .onnx files.
        threads: as in `Entry`.

    Raises:
        ImportError: torch or onnx are not installed.
        ValueError: another size.
    """
    wrong = [size for size in sizes if size < 96 or size % 48]
    if wrong:
        raise ValueError(
            f"crop sizes {wrong} do not fit re3-lite's grids; expected multiples of 48 from 96 on, "
            "such as 96, 144, 192, 240"
        )
    from re3.network.export import export_onnx
    from re3.network.lite_config import LiteConfig
    from re3.network.variants import build

    entries = {}
    for size in sizes:
        shipped = LiteConfig()
        config = replace(shipped, current=replace(shipped.current, size=size))
        path = folder / f"re3-lite-{size}.onnx"
        export_onnx(build(config), path)
        entries[size] = Entry(f"{size} px", True, str(path), threads=threads)
    return entries
