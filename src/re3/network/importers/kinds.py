"""What a kind of weights file is: how it is recognised, what must be in it, what becomes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from re3.network.variants import Network

Shape = tuple[int, ...]
Tensors = Mapping[str, Tensor]

MOST_NAMED = 3
"""Names at most in a list of an error."""


@dataclass(frozen=True)
class Kind:
    """A kind of weights file.

    Attributes:
        name: for people.
        marks: names of tensors that together no other kind has.
        variant: the network that it is for; of convolutions the one that takes them by default.
        whole: it has all weights of a network; otherwise its convolutions alone, beside which it
            may hold anything.
        shapes: name -> shape of all that is needed, given the network.
        convert: tensors of these names to values of the network's state dict; of convolutions
            those of its trunk's.
    """

    name: str
    marks: tuple[str, ...]
    variant: str
    whole: bool
    shapes: Callable[[Network], dict[str, Shape]]
    convert: Callable[[Tensors, Network], dict[str, Tensor]]

    def recognises(self, tensors: Tensors) -> bool:
        """Whether a file looks like this kind."""
        return all(mark in tensors for mark in self.marks)

    def check(self, path: Path, tensors: Tensors, network: Network) -> None:
        """Compare names and shapes.

        Raises:
            ValueError: something is missing, of another shape, or, in a file of a whole network,
                too much; the message names the file and the tensors.
        """
        expected = self.shapes(network)
        missing = [name for name in expected if name not in tensors]
        more = [name for name in tensors if name not in expected] if self.whole else []
        wrong = [
            f"{name} is {tuple(tensors[name].shape)} and not {shape}"
            for name, shape in expected.items()
            if name in tensors and tuple(tensors[name].shape) != shape
        ]
        problems = [
            f"{what}: {_some(names)}"
            for what, names in (
                ("missing", missing),
                ("unknown", more),
                ("of another shape", wrong),
            )
            if names
        ]
        if problems:
            raise ValueError(
                f"{path} looks like {self.name}, but does not fit: {'; '.join(problems)}"
            )


def shapes_of(tensors: Tensors) -> dict[str, Shape]:
    """The shape of each tensor."""
    return {name: tuple(tensor.shape) for name, tensor in tensors.items()}


def _some(names: list[str]) -> str:
    rest = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {rest} more" if rest > 0 else "")
