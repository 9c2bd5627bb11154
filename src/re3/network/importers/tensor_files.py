"""Named tensors out of files of other programs.

The kind of a file is told from its first bytes, Caffe's alone from its name. Nothing in a file is
ever executed: torch's files are pickles, and are read with `weights_only`, which builds tensors and
plain containers and refuses everything else.
"""

from __future__ import annotations

import pickle
import re
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from re3.network.importers.caffemodel import read_caffemodel
from re3.network.importers.tensor_bundle import INDEX_SUFFIX

TORCH_ZIP = b"PK\x03\x04"
PICKLE = b"\x80"
"""Of files that torch wrote before 1.6, or was asked to write in that form."""
HDF5 = b"\x89HDF"
TENSORFLOW_PARTS = (INDEX_SUFFIX, ".meta", ".data-00000-of-00001")

EXPECTED = "expected a PyTorch file (torch.save of a dict of tensors), .safetensors or .caffemodel"


def read_tensors(path: str | Path) -> dict[str, Tensor]:
    """Every tensor in a file, as float32 where it is floating-point.

    Weights of a Caffe layer are called `<layer>.weight` and `<layer>.bias`.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a file of another kind, a damaged one, one that holds more than tensors, or
            values that are not finite.
    """
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{path} is a folder; {EXPECTED}")
    if tensorflow_index(path) is not None:
        raise ValueError(
            f"{path} looks like a TensorFlow checkpoint, which cannot be imported: the names and "
            "the order of its variables are not documented (`re3 weights show` lists them); "
            f"{EXPECTED}"
        )
    if not path.is_file():
        raise FileNotFoundError(f"weights file {path} does not exist")
    with path.open("rb") as file:
        head = file.read(16)
    if not head:
        raise ValueError(f"{path} is empty; {EXPECTED}")
    if path.suffix == ".caffemodel" and not head.startswith(HDF5):
        tensors = _read_caffe(path)  # which begins with no mark of its own
    elif head.startswith((TORCH_ZIP, PICKLE)):
        tensors = _read_torch(path)
    elif head[8:9] == b"{":
        tensors = _read_safetensors(path)
    else:
        raise ValueError(f"{path} begins with {head[:8]!r}, as no known kind does; {EXPECTED}")
    for name, tensor in tensors.items():
        if tensor.is_floating_point():
            if not tensor.isfinite().all():
                raise ValueError(
                    f"{path}: {name} holds NaN or infinity; expected finite weights: is the file "
                    "damaged?"
                )
            tensors[name] = tensor.float()
    return tensors


def tensorflow_index(path: Path) -> Path | None:
    """The index of a TensorFlow checkpoint, of which a part or the common name is given."""
    stem = path.name
    for part in TENSORFLOW_PARTS:
        stem = stem.removesuffix(part)
    index = path.with_name(stem + INDEX_SUFFIX)
    return index if index.is_file() or path.name.endswith(TENSORFLOW_PARTS) else None


def _read_caffe(path: Path) -> dict[str, Tensor]:
    model = read_caffemodel(path)
    names = [layer.name for layer in model.layers]
    if "norm1" in names and "pool1" in names[names.index("norm1") :]:
        raise ValueError(
            f"{path} is Caffe's AlexNet ({model.name!r}), which normalises before it pools; "
            "expected CaffeNet (bvlc_reference_caffenet), which does so after"
        )
    tensors = {}
    for layer in model.layers:
        for part, blob in zip(("weight", "bias"), layer.blobs, strict=False):
            values = blob.reshape(-1) if part == "bias" else blob  # in old files [1, 1, 1, out]
            tensors[f"{layer.name}.{part}"] = torch.from_numpy(values)
    return tensors


def _read_torch(path: Path) -> dict[str, Tensor]:
    try:
        loaded = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise ValueError(
            f"{path} holds more than tensors ({_more_than_tensors(error)}), and was not loaded, "
            "since that could run code; expected a plain state dict, as torch.save of a network's "
            "state_dict() writes it"
        ) from error
    except Exception as error:  # a damaged pickle fails wherever it happens to
        raise ValueError(
            f"{path} cannot be read as a PyTorch file: {_first_line(error)}; is it complete?"
        ) from error
    if not isinstance(loaded, Mapping):
        raise ValueError(f"{path} holds a {type(loaded).__name__}; expected a dict of tensors")
    for name, value in loaded.items():
        if not isinstance(name, str) or not isinstance(value, Tensor):
            raise ValueError(
                f"{path}: {name!r} is a {type(value).__name__}; expected a plain dict of names and "
                "tensors (a state dict)"
            )
    return dict(loaded)


def _read_safetensors(path: Path) -> dict[str, Tensor]:
    try:
        return load_file(path)
    except SafetensorError as error:
        raise ValueError(f"{path} cannot be read as safetensors: {error}") from error


def _more_than_tensors(error: pickle.UnpicklingError) -> str:
    """What torch refused, out of pages of advice on how to load it all the same."""
    found = re.search(r"GLOBAL (\S+)", f"{error}")
    return found[1] if found else "an unknown object"


def _first_line(error: BaseException) -> str:
    return f"{error}".strip().split("\n")[0] or type(error).__name__
