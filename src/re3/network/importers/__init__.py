"""Weights of other programs: the authors' checkpoints, and convolutions trained on ImageNet.

`import_file` tells what a file is from the names in it and gives a network with its weights.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from re3.network.importers.checkpoints import LARGE, SMALL
from re3.network.importers.convolutions import KINDS as CONVOLUTIONS
from re3.network.importers.convolutions import fits
from re3.network.importers.kinds import Kind, Tensors
from re3.network.importers.tensor_files import read_tensors
from re3.network.variants import VARIANTS, Network, build

__all__ = ["KINDS", "Imported", "convolutions_in", "fits", "import_file", "recognise"]

KINDS: tuple[Kind, ...] = (LARGE, SMALL, *CONVOLUTIONS)


@dataclass(frozen=True)
class Imported:
    """What came of a file.

    Attributes:
        network: of a named variant, with the file's weights.
        kind: what the file was taken for.
        values: how many of the network's values are from the file.
    """

    network: Network
    kind: Kind
    values: int


def import_file(path: str | Path, into: str | None = None, seed: int = 0) -> Imported:
    """Read a file of weights into a network.

    Args:
        path: a PyTorch file, .safetensors or .caffemodel, of one of `KINDS`.
        into: variant that takes the file's convolutions; by default the one that its kind names. A
            file of a whole network knows its own.
        seed: of the weights that a file of convolutions does not have.

    Raises:
        FileNotFoundError: no such file.
        ValueError: no such kind of file, a damaged one, one that holds more than tensors, or one
            that does not fit the network; nothing in it is executed.
    """
    path = Path(path)
    tensors = read_tensors(path)
    kind = recognise(tensors)
    if kind is None:
        named = ", ".join(list(tensors)[:3]) or "none"
        raise ValueError(
            f"{path} has {len(tensors)} tensors ({named}, ...), which are of no known network; "
            f"expected {', '.join(kind.name for kind in KINDS)}"
        )
    if kind.whole and into not in (None, kind.variant):
        raise ValueError(
            f"{path} is {kind.name}, all of it: it becomes {kind.variant!r} and cannot go into "
            f"{into!r}; leave out --into, which is for files of convolutions"
        )
    variant = into or kind.variant
    with torch.device("meta"):  # shapes without values: quick to build, however large
        outline = build(variant)
    kind.check(path, tensors, outline)
    values = kind.convert(tensors, outline)
    if not kind.whole and not fits(values, outline.trunk):
        raise ValueError(
            f"{path} has the convolutions of {kind.name}, which are not those of {variant!r}; "
            f"expected --into one of {', '.join(_takers(values)) or '(none takes them)'}"
        )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = build(variant)
    part = network if kind.whole else network.trunk
    part.load_state_dict({**part.state_dict(), **values})
    return Imported(network, kind, sum(value.numel() for value in values.values()))


def convolutions_in(path: str | Path) -> dict[str, Tensor]:
    """The convolutions that a file has, under the names of the trunk that they fit (`fits`).

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is none of convolutions, or a damaged one.
    """
    path = Path(path)
    tensors = read_tensors(path)
    kind = recognise(tensors)
    if kind is None or kind.whole:
        raise ValueError(
            f"{path} is not known as a file of convolutions; expected one of "
            f"{', '.join(kind.name for kind in CONVOLUTIONS)}"
        )
    with torch.device("meta"):
        outline = build(kind.variant)
    kind.check(path, tensors, outline)
    return kind.convert(tensors, outline)


def recognise(tensors: Tensors) -> Kind | None:
    """What kind of file has tensors of these names; None for another."""
    return next((kind for kind in KINDS if kind.recognises(tensors)), None)


def _takers(values: dict[str, Tensor]) -> list[str]:
    """Names of the variants whose trunk has these weights."""
    found = []
    for name in VARIANTS:
        with torch.device("meta"):
            outline = build(name)
        if fits(values, outline.trunk):
            found.append(name)
    return found
