"""`re3 export`: write a network's one-step graph for ONNX Runtime."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from re3.apps.console import failed, stderr


def export(
    weights: Annotated[
        Path, typer.Argument(help="Weights (.safetensors, or an .onnx file).", metavar="WEIGHTS")
    ],
    out: Annotated[Path, typer.Argument(help="The .onnx file to write.", metavar="OUT")],
    half: Annotated[
        bool, typer.Option(help="Store weights as fp16: half the size, the same arithmetic.")
    ] = True,
) -> None:
    """Write the one-step graph, with explicit state in and out.

    Example:

        re3 export runs/mine/re3-lite.safetensors mine.onnx
    """
    try:
        from re3.network.export import export_onnx
        from re3.network.weights import load_network

        export_onnx(load_network(weights), out, half_weights=half)
    except ImportError as error:
        raise failed(f"export needs torch and onnx ({error}): pip install 're3[train]'") from error
    except (OSError, ValueError) as error:
        raise failed(error) from error
    stderr().print(f"{out}: {out.stat().st_size / 1e6:.1f} MB", markup=False)
