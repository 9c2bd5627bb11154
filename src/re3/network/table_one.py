"""The models of the ablation study, A to K (Re3, Table I), at two scales.

A variant says what differs from the full model, in network and in training; a scale says how large
everything is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from re3.model_spec import CropSpec
from re3.network.caffenet import CROP_SIZE
from re3.network.efficientnet_lite import PIXEL_MEAN
from re3.network.re3 import Re3Config


@dataclass(frozen=True)
class Variant:
    """A row of Table I; what is not said is as in the full model.

    Attributes:
        letter: of the row.
        about: what it is.
        lstm_layers: 2 or 1, after one fully connected layer; 0: three larger ones and no LSTM.
        skips: skip connections beside the last map.
        other_trunk: the scale's other convolutions.
        own_predictions: crops at the network's own predictions while training (self-training).
        simulated: trained on simulated sequences as well as on videos.
        large_source: trained on the largest source of videos, ImageNet Video in the paper.
        other_source: trained on the second largest, ALOV in the paper.
        reset: the recurrent state is reset while tracking.
    """

    letter: str
    about: str
    lstm_layers: int = 2
    skips: bool = True
    other_trunk: bool = False
    own_predictions: bool = True
    simulated: bool = True
    large_source: bool = True
    other_source: bool = True
    reset: bool = True

    @property
    def training(self) -> Variant:
        """All that training depends on: variants that are alike in this have the same weights."""
        return replace(self, letter="", about="", reset=True)


_FEED_FORWARD = Variant("", "", lstm_layers=0, skips=False, own_predictions=False)
_ONE_LAYER = Variant("", "", lstm_layers=1, skips=False)

VARIANTS = {
    variant.letter: variant
    for variant in (
        replace(_FEED_FORWARD, letter="A", about="feed-forward (GOTURN)", large_source=False),
        replace(_FEED_FORWARD, letter="B", about="A + large source of videos"),
        replace(
            _ONE_LAYER, letter="C", about="one-layer LSTM", own_predictions=False, simulated=False
        ),
        replace(_ONE_LAYER, letter="D", about="C + own predictions", simulated=False),
        replace(_ONE_LAYER, letter="E", about="D + simulated data"),
        replace(_ONE_LAYER, letter="F", about="E + skip connections", skips=True),
        Variant("G", "full model: F with two LSTM layers"),
        Variant("H", "G without the other source", other_source=False),
        Variant("I", "G without the large source", large_source=False),
        Variant("J", "G without reset", reset=False),
        Variant("K", "G with other convolutions", other_trunk=True),
    )
}
"""Letter -> row, in the order of the table.

That A is trained on simulated data and C is not follows the paper as far as it goes: GOTURN learns
from still pictures too, and E is what adds simulated data to D.
"""


@dataclass(frozen=True)
class Scale:
    """How large the variants are.

    Attributes:
        name: of the scale.
        trunk, other_trunk: convolutions, names in `re3.network.re3.TRUNKS`; the second are K's.
        crop: of the current frame.
        previous: of the previous frame.
        fill: BGR colour of what lies outside the frame.
        skips: channels of the skip connections.
        fully_connected: units of the layer before an LSTM.
        feed_forward: units of each of three layers where there is no LSTM.
        lstm_units: units of each LSTM cell.
        reset_interval: steps between two resets.
    """

    name: str
    trunk: str
    other_trunk: str
    crop: CropSpec
    previous: CropSpec
    fill: tuple[float, float, float]
    skips: tuple[int, ...]
    fully_connected: int
    feed_forward: int
    lstm_units: int
    reset_interval: int = 32

    def config(self, variant: Variant) -> Re3Config:
        """A variant's network at this scale, called `lite-A`, say."""
        recurrent = variant.lstm_layers > 0
        return Re3Config(
            name=f"{self.name}-{variant.letter}",
            crop=self.crop,
            previous=self.previous,
            fill=self.fill,
            trunk=self.other_trunk if variant.other_trunk else self.trunk,
            skips=self.skips if variant.skips else (),
            fully_connected=self.fully_connected if recurrent else self.feed_forward,
            fully_connected_layers=1 if recurrent else 3,
            lstm_layers=variant.lstm_layers,
            lstm_units=self.lstm_units,
            reset_interval=self.reset_interval if recurrent and variant.reset else 0,
        )


SCALES = {
    scale.name: scale
    for scale in (
        Scale(
            name="paper",
            trunk="caffenet",
            other_trunk="googlenet",
            crop=CropSpec(context=2.0, size=CROP_SIZE),
            previous=CropSpec(context=2.0, size=CROP_SIZE),
            fill=(0.0, 0.0, 0.0),
            skips=(16, 32, 64),
            fully_connected=2048,
            feed_forward=4096,
            lstm_units=1024,
        ),
        Scale(
            name="lite",
            trunk="efficientnet-lite0",
            other_trunk="alexnet",
            # As re3-lite sees them: the current crop reaches further, at the same pixels a box.
            crop=CropSpec(context=3.0, size=192),
            previous=CropSpec(context=2.0, size=128),
            fill=(PIXEL_MEAN, PIXEL_MEAN, PIXEL_MEAN),
            skips=(4, 8, 16),
            fully_connected=384,
            feed_forward=768,
            lstm_units=256,
        ),
    )
}
"""Name -> scale."""

CONFIGS = {
    config.name: config
    for scale in SCALES.values()
    for config in map(scale.config, VARIANTS.values())
}
"""Name -> network of every variant at every scale."""
