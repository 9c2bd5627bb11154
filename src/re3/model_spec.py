"""What a tracker must know of a model to drive it: crops, colours, reset rule and state.

The same description is written into every exported file, so that a file is complete in itself.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from re3.geometry import REGRESSION_SCALE

SPEC_KEY = "re3_spec"
"""Metadata key under which an exported file carries its `ModelSpec` as JSON."""


DATA_SUFFIX = ".data"
"""After the name of an exported .onnx file: that of the file with its weights, where they lie
apart."""


@dataclass(frozen=True)
class CropSpec:
    """How a crop is cut.

    Attributes:
        context: side of the region in units of the box's side (the paper's padding is 2).
        size: side of the square crop in pixels.
    """

    context: float
    size: int

    def __post_init__(self) -> None:
        if not self.context >= 1.0:
            raise ValueError(f"context is {self.context}; expected 1 or more (the paper uses 2)")
        if self.size < 16:
            raise ValueError(f"crop size is {self.size}; expected 16 pixels or more")


@dataclass(frozen=True)
class ModelSpec:
    """Interface of a one-step network.

    Attributes:
        name: of the variant, such as "re3-lite".
        previous: crop of the previous frame, centred on the previous box; None for a network that
            remembers in its state what it saw of that frame.
        current: crop of the current frame, centred on the same box.
        fill: BGR colour of what lies outside the frame.
        state: name -> shape of one object's recurrent state, without the batch dimension.
            Every state starts at zero.
        kept_at_reset: names of states that concern the previous frame alone: a reset, which makes
            the model of the object forget, leaves them.
        reset_interval: after so many steps the state returns to the one after the first forward
            pass (Re3, sec. III-C, "Tracking at test time"); 0 never resets.
        look_at_reset: after a reset both crops are cut about the object's box in the current frame
            and passed through the network, and the state after that pass goes on.
        whole_pixels: crops are cut about regions rounded to whole pixels and resized without
            averaging (`re3.whole_pixel_crop`), while boxes are decoded from the regions as they
            are.
        regression_scale: see `re3.geometry.REGRESSION_SCALE`.
    """

    name: str
    previous: CropSpec | None
    current: CropSpec
    fill: tuple[float, float, float]
    state: dict[str, tuple[int, ...]]
    kept_at_reset: tuple[str, ...] = ()
    reset_interval: int = 32
    look_at_reset: bool = False
    whole_pixels: bool = False
    regression_scale: float = REGRESSION_SCALE

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> ModelSpec:
        """Read what `to_json` wrote.

        Raises:
            ValueError: the text is not such a description.
        """
        try:
            values = json.loads(text)
            return ModelSpec(
                name=values["name"],
                previous=CropSpec(**values["previous"]) if values["previous"] else None,
                current=CropSpec(**values["current"]),
                fill=tuple(values["fill"]),
                state={name: tuple(shape) for name, shape in values["state"].items()},
                kept_at_reset=tuple(values["kept_at_reset"]),
                reset_interval=values["reset_interval"],
                # Files of before these rules existed do not name them.
                look_at_reset=values.get("look_at_reset", False),
                whole_pixels=values.get("whole_pixels", False),
                regression_scale=values["regression_scale"],
            )
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            raise ValueError(
                f"not a re3 model description: {error!r} in {text[:80]!r}; "
                "export the model again with `re3 export`"
            ) from error
