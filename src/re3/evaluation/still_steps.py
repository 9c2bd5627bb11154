"""Inputs of a network's steps about a box that stays: footage to find ranges of maps on."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from re3 import geometry
from re3.engine import zero_state
from re3.model_spec import ModelSpec


def still_steps(
    spec: ModelSpec, frames: Sequence[NDArray[np.uint8]], box_xywh: Sequence[float]
) -> list[dict[str, NDArray]]:
    """One step for each two neighbouring frames, of one object, from the state before the first.

    Args:
        spec: of the network.
        frames: uint8 `[H, W, 3]`, two or more.
        box_xywh: about which all crops are cut, in pixels.

    Returns:
        name of an input -> its value, as ONNX Runtime takes them.
    """
    box = geometry.convert(box_xywh, "xywh", "xyxy")
    state = zero_state(spec, 1)
    steps = []
    for before, now in pairwise(frames):
        feeds: dict[str, NDArray] = dict(state)
        for name, frame, view in (
            ("previous_crops", before, spec.previous),
            ("current_crops", now, spec.current),
        ):
            if view is not None:
                region = geometry.search_region(box, view.context)
                feeds[name] = geometry.crop(frame, region, view.size, spec.fill)[None]
        steps.append(feeds)
    return steps
