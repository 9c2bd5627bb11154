"""`re3 export`: write a network's one-step graph for other runtimes, with a card and examples."""

from __future__ import annotations

import json
import shutil
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from re3.apps.console import failed, stderr
from re3.benchmark.footage import made_footage
from re3.evaluation.still_steps import still_steps
from re3.exported.card import make_card
from re3.model_spec import DATA_SUFFIX
from re3.models import find_weights, is_mirrored, list_models

if TYPE_CHECKING:
    from re3.network.export import Change
    from re3.network.re3_lite import Re3Lite
    from re3.network.variants import Network

CALIBRATION_FRAMES = 30

EXAMPLES = Path(__file__).parents[1] / "exported"


class Format(str, Enum):
    """What is written."""

    ONNX = "onnx"
    OPENVINO = "openvino"
    TORCHSCRIPT = "torchscript"


SUFFIXES = {Format.ONNX: (".onnx",), Format.OPENVINO: (".xml",), Format.TORCHSCRIPT: (".pt", ".ts")}


def export(
    weights: Annotated[
        str,
        typer.Argument(
            help="Weights (.safetensors, or an .onnx file), or a model's name.", metavar="WEIGHTS"
        ),
    ],
    out: Annotated[
        Path,
        typer.Argument(
            help="The file to write: .onnx; .xml for OpenVINO, .pt for TorchScript.", metavar="OUT"
        ),
    ],
    format_: Annotated[
        Format | None,
        typer.Option("--format", help="Default: what OUT ends in.", show_default=False),
    ] = None,
    int8: Annotated[
        bool,
        typer.Option(
            "--int8",
            help="Compute in 8 bits: convolutions of re3-lite (give --calibrate); large products, "
            "fully connected and LSTM layers, of networks like the paper's.",
        ),
    ] = False,
    calibrate: Annotated[
        list[Path] | None,
        typer.Option(
            help="For --int8 of re3-lite: annotated clips like those to be tracked; the ranges of "
            "values are taken from tracking them. May be given several times.",
            metavar="CLIPS",
        ),
    ] = None,
    opset: Annotated[
        int, typer.Option(help="Version of ONNX's operators, 13 to 20.", metavar="N")
    ] = 17,
    half: Annotated[
        bool, typer.Option(help="Store weights as fp16: half the size, the same arithmetic.")
    ] = True,
    examples: Annotated[
        bool, typer.Option(help="Write examples in Python and C++ beside an .onnx file.")
    ] = True,
    untrained: Annotated[
        bool,
        typer.Option(
            "--untrained",
            help="WEIGHTS names a network, which is written with random weights: for measuring "
            "speed alone.",
        ),
    ] = False,
) -> None:
    """Write the one-step graph, with explicit state in and out.

    Beside it come a card, OUT with .json after it (m.onnx.json), which says all that a
    program must know to track with the file, and, beside an .onnx file, two
    short programs that do so: track_onnx.py and track_onnx.cpp.

    Examples:

        re3 export runs/mine/re3-lite.safetensors mine.onnx

        re3 export re3-lite boards/re3-lite.xml --format openvino

        re3 export re3 paper.onnx --int8 --untrained

        re3 export runs/mine/re3-lite.safetensors small.onnx --int8 --calibrate clips
    """
    try:
        chosen = _format(out, format_)
        network = _network(weights, untrained)
        from re3.network.mirrored import Mirrored
        from re3.network.re3_lite import Re3Lite

        if int8 and chosen is Format.TORCHSCRIPT:
            raise ValueError("--int8 is of an ONNX graph; take --format onnx or openvino for it")
        change = None
        if int8 and isinstance(network, Re3Lite):
            network = _in_eight_bits(network, calibrate)
        elif int8 and isinstance(network, Mirrored) and isinstance(network.once, Re3Lite):
            network = Mirrored(_in_eight_bits(network.once, calibrate), network.name)
        elif int8:
            change = _to_8_bits(network, untrained)
        if calibrate and (change is not None or not int8):
            raise ValueError("--calibrate is for re3-lite with --int8; leave it out")
        from re3.network.export import export_onnx
        from re3.network.export_formats import export_openvino, export_torchscript

        if chosen is Format.ONNX:
            # What is fp16 in the file is held twice for a while as it is loaded.
            export_onnx(
                network,
                out,
                half_weights=half and change is None,
                opset=opset,
                change=change,
                weights_apart=change is not None,
            )
        elif chosen is Format.OPENVINO:
            export_openvino(network, out, opset=opset, change=change)
        else:
            export_torchscript(network, out)
        about = {
            "format": chosen.value,
            "opset": None if chosen is Format.TORCHSCRIPT else opset,
            "weights": _stored(chosen, change is not None, int8, half),
            "trained": not untrained,
        }
        card = make_card(network.spec(), out.name, **about)
        # After the whole name: m.onnx and m.xml in one folder have a card each.
        card_file = out.with_name(f"{out.name}.json")
        card_file.write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")
        written = [out, card_file, *_weights_beside(out)]
        if chosen is Format.ONNX and examples:
            written += [_copied(name, out) for name in ("track_onnx.py", "track_onnx.cpp")]
    except ImportError as error:
        extra = "openvino" if "openvino" in str(error) else "train"
        raise failed(
            f"export needs torch and onnx, and OpenVINO for its format ({error}): "
            f"pip install 're3[{extra}]'"
        ) from error
    except (OSError, ValueError) as error:
        raise failed(error) from error
    size = sum(path.stat().st_size for path in (out, *_weights_beside(out)))
    stderr().print(f"{out}: {size / 1e6:.1f} MB", markup=False)
    stderr().print(f"beside it: {', '.join(path.name for path in written[1:])}", markup=False)


def _format(out: Path, asked: Format | None) -> Format:
    if asked is None:
        asked = next((f for f, suffixes in SUFFIXES.items() if out.suffix in suffixes), None)
    if asked is None or out.suffix not in SUFFIXES[asked]:
        known = "; ".join(f"{f.value}: {' or '.join(s)}" for f, s in SUFFIXES.items())
        what = "names no format" if asked is None else f"is no file of format {asked.value}"
        raise ValueError(f"{out} {what} by its end; expected {known}")
    return asked


def _network(weights: str, untrained: bool) -> Network:
    """The network to write.

    Raises:
        ImportError: torch is not installed.
        ValueError, OSError: no such weights or network.
    """
    from re3.network.mirrored import Mirrored
    from re3.network.untrained import build_untrained
    from re3.network.weights import load_network

    if untrained:
        return build_untrained(weights)
    path = Path(weights)
    if not path.suffix and weights in {card.name for card in list_models()}:
        try:
            path = find_weights(weights)
        except ValueError as error:
            raise ValueError(
                f"{error}; or write it with random weights, to measure speed, with --untrained"
            ) from error
    network = load_network(path)
    return Mirrored(network, weights) if is_mirrored(weights) else network


def _in_eight_bits(network: Re3Lite, clips: list[Path] | None) -> Re3Lite:
    from re3.apps.calibration import recorded_steps
    from re3.network.quantize import quantize

    if not clips:
        raise ValueError(
            "--int8 of re3-lite needs the ranges of its values; give a folder of annotated clips "
            "with --calibrate"
        )
    return quantize(network, recorded_steps(network, clips))


def _to_8_bits(network: Network, untrained: bool) -> Change:
    """What makes the graph of a network one of 8 bits.

    Ranges of the trunk's maps have to be seen: where weights are random, made frames serve.
    """
    from re3.network.quantize_products import quantize_products
    from re3.network.quantize_trunk import quantize_trunk

    if not untrained:
        return quantize_products
    footage = made_footage(CALIBRATION_FRAMES)
    steps = still_steps(network.spec(), footage.frames, footage.box_xywh)
    return lambda model: quantize_trunk(quantize_products(model), steps)


def _stored(chosen: Format, products: bool, int8: bool, half: bool) -> str:
    if products:
        return "8 bits in large products, which run on 8-bit integers; fp32 elsewhere"
    if int8:
        return "8 bits in convolutions, fully connected layer and LSTM, which run on 8-bit integers"
    if chosen is Format.TORCHSCRIPT or (chosen is Format.ONNX and not half):
        return "fp32"
    return "fp16, arithmetic as the runtime chooses; fp32 in ONNX Runtime"


def _copied(name: str, out: Path) -> Path:
    return Path(shutil.copyfile(EXAMPLES / name, out.parent / name))


def _weights_beside(out: Path) -> list[Path]:
    """A second file with the weights: OpenVINO's, and that of large ONNX graphs."""
    beside = (
        out.with_suffix(".bin") if out.suffix == ".xml" else out.with_name(out.name + DATA_SUFFIX)
    )
    return [beside] if beside.is_file() else []
