"""A training step recorded once as a CUDA graph and replayed.

A step launches some thousands of small kernels, and a host that launches them one by one keeps a
large GPU waiting for half of the time (docs/training.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import torch
from torch import Tensor, nn

from re3.training.packed.clips import ClipBatch

WARM_UP = 3
"""Runs before recording, in which libraries choose and allocate what they need."""


class RecordedStep:
    """Gradients of a batch of clips, replayed from a CUDA graph.

    Args:
        gradients: of clips on the device; leaves gradients in the parameters and returns figures.
            Waits for nothing, copies nothing from the host, and has the same shapes every time.
        clips: an example, on the device.
        parameters: whose gradients it leaves; they stay in the same memory from here on, and must
            not be set to None.
        generator: of the random numbers in `gradients`, on the device.

    Raises:
        RuntimeError: something in the step cannot be recorded.
    """

    def __init__(
        self,
        gradients: Callable[[ClipBatch], Tensor],
        clips: ClipBatch,
        parameters: list[nn.Parameter],
        generator: torch.Generator,
    ) -> None:
        self.clips = ClipBatch(**{f.name: getattr(clips, f.name).clone() for f in fields(clips)})
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(WARM_UP):
                _forget(parameters)
                gradients(self.clips)
        torch.cuda.current_stream().wait_stream(stream)
        _forget(parameters)
        self.graph = torch.cuda.CUDAGraph()
        self.graph.register_generator_state(generator)
        with torch.cuda.graph(self.graph):
            self.figures = gradients(self.clips)

    def __call__(self, clips: ClipBatch) -> Tensor:
        """The figures of other clips, of the same shapes; their gradients in the parameters.

        The figures are overwritten by the next call.
        """
        for field in fields(clips):
            getattr(self.clips, field.name).copy_(getattr(clips, field.name), non_blocking=True)
        self.graph.replay()
        return self.figures


def _forget(parameters: list[nn.Parameter]) -> None:
    for parameter in parameters:
        parameter.grad = None
