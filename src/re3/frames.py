"""Frames as users have them, brought to the one form the tracker works on."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def as_bgr(frame: object) -> NDArray[np.uint8]:
    """A frame as uint8 `[H, W, 3]` BGR.

    Args:
        frame: uint8 array: `[H, W, 3]` BGR, `[H, W, 4]` BGRA, or `[H, W]` or `[H, W, 1]` grey;
            need not be contiguous.

    Returns:
        the frame itself where it is in that form already, else a copy.

    Raises:
        ValueError: anything else; says what came and what is expected.
    """
    expected = (
        "expected a uint8 array [H, W, 3] in BGR order ([H, W] grey or [H, W, 4] BGRA work too)"
    )
    if not isinstance(frame, np.ndarray):
        raise ValueError(f"frame is {type(frame).__name__}; {expected}")
    given = f"frame has shape {frame.shape} and dtype {frame.dtype}"
    if frame.dtype != np.uint8:
        raise ValueError(
            f"{given}; {expected}. Scale it to 0..255 and convert it with .astype(numpy.uint8)"
        )
    if frame.ndim not in (2, 3) or (frame.ndim == 3 and frame.shape[2] not in (1, 3, 4)):
        raise ValueError(f"{given}; {expected}")
    if frame.size == 0:
        raise ValueError(f"{given}, that is, no pixels; {expected}")
    # OpenCV takes rows that lie apart, as video decoders leave them, but no gaps within a row.
    if frame.strides[1:] != np.empty((1, *frame.shape[1:]), np.uint8).strides[1:] or (
        frame.strides[0] < 0
    ):
        frame = np.ascontiguousarray(frame)
    if frame.ndim == 2 or frame.shape[2] == 1:
        return cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)
    if frame.shape[2] == 4:
        return cv2.cvtColor(frame, cv2.COLOR_BGRA2BGR)
    return frame
