"""Sizes of `re3-lite` and what it remembers of an object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from torch import Tensor

from re3.model_spec import CropSpec, ModelSpec
from re3.network.efficientnet_lite import PIXEL_MEAN
from re3.network.peephole_lstm import FactoredLSTM

STRIDE = 8
"""Stride of the embedding's grid."""


@dataclass(frozen=True)
class LiteConfig:
    """Sizes of a `re3-lite` variant; channels unless said otherwise.

    Attributes:
        current: crop of the current frame.
        view: side of the view of the previous frame in units of the box's side (the paper's
            padding). Its middle, the object, is the template.
        skips: outputs of the skip connections from strides 4, 8 and 16 (sec. III-A).
        embedding: of a crop's embedding.
        adapter: inside the blocks that fit the trunk's maps to tracking.
        correlation: kept of each correlation.
        fused: of the fused map.
        fully_connected: units of the fully connected layer.
        lstm_units: units of each LSTM cell.
        reset_interval: steps between two resets of the recurrent state.
        lean: one slope for each PReLU, not one for each channel, and in eight bits what residual
            blocks add up is rounded as well: a tenth to a seventh less time.
    """

    name: str = "re3-lite"
    current: CropSpec = CropSpec(context=3.0, size=192)
    view: float = 2.0
    skips: tuple[int, int, int] = (16, 32, 64)
    embedding: int = 64
    adapter: int = 64
    correlation: int = 48
    fused: int = 64
    fully_connected: int = 384
    lstm_units: int = 256
    reset_interval: int = 32
    lean: bool = True

    def __post_init__(self) -> None:
        if self.current.size % 16:
            raise ValueError(
                f"crop size {self.current.size} is not a multiple of the trunk's stride 16"
            )
        if not 1.0 <= self.view <= self.current.context:
            raise ValueError(
                f"the view is {self.view} boxes wide; expected 1 or more, and no more than the "
                f"current crop's {self.current.context}"
            )

    @property
    def grid(self) -> int:
        """Side of a current crop's embedding."""
        return self.current.size // STRIDE

    @property
    def view_cells(self) -> int:
        """Side of the view of the previous frame, at the current crop's pixels per object."""
        return round(self.current.size / self.current.context * self.view / STRIDE)

    @property
    def template_cells(self) -> int:
        """Side of the template: the object's part of a view."""
        return round(self.view_cells / self.view)

    def spec(self) -> ModelSpec:
        """What a tracker must know to drive such a network."""
        units = self.lstm_units
        return ModelSpec(
            name=self.name,
            previous=None,
            current=self.current,
            fill=(PIXEL_MEAN, PIXEL_MEAN, PIXEL_MEAN),
            state={
                **dict.fromkeys(FactoredLSTM.STATE_NAMES, (units,)),
                "template": (self.embedding, self.template_cells, self.template_cells),
                "view": (self.embedding, self.view_cells, self.view_cells),
                "started": (1,),
            },
            kept_at_reset=("view",),
            reset_interval=self.reset_interval,
        )


class LiteState(NamedTuple):
    """Recurrent state of N objects; all zeros before the first forward pass."""

    lstm1_output: Tensor  # [N, units]
    lstm1_cell: Tensor  # [N, units]
    lstm2_output: Tensor  # [N, units]
    lstm2_cell: Tensor  # [N, units]
    template: Tensor  # [N, embedding, cells, cells]: the object in the first frame
    view: Tensor  # [N, embedding, cells, cells]: about the box in the previous frame
    started: Tensor  # [N, 1]: 0 before the first forward pass, 1 after it
