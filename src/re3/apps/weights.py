"""`re3 weights`: take over weights that other programs wrote."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from re3.apps.console import failed, stderr

NEEDS_MORE = "files of weights need more than tracking does"

weights = typer.Typer(name="weights", no_args_is_help=True)


@weights.callback()
def _root() -> None:
    """Take over weights of other programs: the authors' checkpoints, pretrained convolutions.

    Examples:

        re3 weights import checkpoint.pth --out authors

        re3 weights show bvlc_googlenet.caffemodel
    """


@weights.command(name="import")
def import_weights(
    file: Annotated[
        Path,
        typer.Argument(
            help="A PyTorch file (a plain state dict), .safetensors or .caffemodel.",
            metavar="FILE",
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder to write to.", metavar="DIR")
    ] = Path("weights"),
    into: Annotated[
        str | None,
        typer.Option(
            help="Of a file of convolutions: the network that starts from them. Default: the "
            "paper's, with these convolutions.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(help="Of a file of convolutions: of the weights that it does not have."),
    ] = 0,
    half: Annotated[
        bool,
        typer.Option(help="Store the weights in the .onnx file as fp16: half the size."),
    ] = True,
) -> None:
    """Turn a file of another program's weights into weights of re3.

    What the file is follows from the names in it; nothing in it is executed.
    The authors' PyTorch checkpoints, large and small, become a network that
    tracks: NAME.safetensors, exactly as it was, and NAME.onnx. CaffeNet and
    GoogLeNet of Caffe, and AlexNet of torchvision, become a network to train,
    NAME-start.safetensors: its convolutions from the file, the rest fresh.

    Examples:

        re3 weights import checkpoint.pth --out authors

        re3 weights import bvlc_reference_caffenet.caffemodel --into re3 --out start
    """
    try:
        from re3.network.export import export_onnx
        from re3.network.importers import import_file
        from re3.network.weights import save_weights

        imported = import_file(file, into, seed)
        network = imported.network
        name = network.spec().name
        if not imported.kind.whole:
            name += "-start"
        written = [out / f"{name}.safetensors"]
        save_weights(network, written[0])
        if imported.kind.whole:
            written.append(out / f"{name}.onnx")
            export_onnx(network, written[1], half_weights=half)
    except ImportError as error:
        raise failed(f"{NEEDS_MORE} ({error}): pip install 're3[train]'") from error
    except (OSError, ValueError) as error:
        raise failed(error) from error
    console = stderr()
    console.print(
        f"{file}: {imported.kind.name}, {imported.values / 1e6:.1f} M values", markup=False
    )
    for path in written:
        console.print(f"{path}: {path.stat().st_size / 1e6:.1f} MB", markup=False)
    if imported.kind.whole:
        console.print(
            f"track with: re3 track CLIP --box X,Y,W,H --model {written[-1]}", markup=False
        )


@weights.command()
def show(
    file: Annotated[
        Path,
        typer.Argument(
            help="A file as of `import`, or a TensorFlow checkpoint: its .index, or the name that "
            "its files begin with.",
            metavar="FILE",
        ),
    ],
) -> None:
    """List the names and shapes of the tensors in a file of weights.

    Example:

        re3 weights show checkpoint.pth
    """
    try:
        from re3.network.importers import recognise
        from re3.network.importers.kinds import shapes_of
        from re3.network.importers.tensor_bundle import read_shapes
        from re3.network.importers.tensor_files import read_tensors, tensorflow_index

        index = tensorflow_index(file)
        if index is not None:
            shapes, what = read_shapes(index), "a TensorFlow checkpoint, which cannot be imported"
        else:
            tensors = read_tensors(file)
            kind = recognise(tensors)
            shapes, what = shapes_of(tensors), "of no known network" if kind is None else kind.name
    except ImportError as error:
        raise failed(f"{NEEDS_MORE} ({error}): pip install 're3[train]'") from error
    except (OSError, ValueError) as error:
        raise failed(error) from error
    for name, shape in shapes.items():
        typer.echo(f"{name}\t{' x '.join(map(str, shape)) or 'one value'}")
    values = sum(math.prod(shape) for shape in shapes.values())
    stderr().print(
        f"{file}: {len(shapes)} tensors, {values / 1e6:.1f} M values; {what}", markup=False
    )
