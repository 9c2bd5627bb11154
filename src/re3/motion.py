"""Where to look next: where the object will be, by how it and the camera have been moving.

The crop of a step reaches one box beyond the object on every side. To a small object seen from a
moving camera that is a few pixels. So the crop is not cut about the last box but about where that
box is expected: four simple guesses are made, each counts as it has been right of late, and their
mean is where the crop goes. The network still says where the object is.

How the camera moves is told by phase correlation of the frame and the one before, both scaled down
(Kuglin and Hines, "The Phase Correlation Image Alignment Method", 1975).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.geometry import Floats

Step = tuple[float, float]
"""x and y in pixels of the frame."""

STILL: Step = (0.0, 0.0)

THUMBNAIL_SIDE = 128
"""Longer side in pixels at most of what the camera's motion is measured in: more tells no better
where objects will be (docs/experiments.md)."""

LEAST_PEAK = 0.1
"""Height of the peak of phase correlation, in 0..1, below which the frames have no common motion,
as at a cut."""

ERROR_RATE, STEP_RATE = 0.2, 0.5
"""Share of the newest frame in the mean error of a guess, and in the mean step of an object."""

ERROR_FLOOR = 0.01
"""Boxes by which every guess is taken to be wrong besides: without, one that happened to be right
would count alone."""

LEAST_SHIFT = 0.2
"""Boxes: a crop less far off is cut about the last box. It would show the network the same, and
small errors of the guesses would be left. Chosen on val and on training clips, as the rates were:
docs/experiments.md."""


def thumbnail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A frame scaled down, for `camera_motion`: its green channel, of `THUMBNAIL_SIDE` at most.

    Args:
        image: uint8 `[H, W, 3]`, BGR.

    Returns:
        uint8 `[h, w]`, without the last pixels that a Fourier transform would not take.
    """
    height, width = image.shape[:2]
    step = _step(width, height)
    # Few pixels are read, since reading takes the time; two are averaged for each of the result.
    sparse = np.ascontiguousarray(image[:: 2 * step, ::step, 1])
    columns, rows = _even(sparse.shape[1] // 2), _even(sparse.shape[0])
    pairs = sparse[:rows, : 2 * columns]
    small = cv2.resize(pairs, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def camera_motion(
    before: NDArray[np.uint8], now: NDArray[np.uint8], width: int, height: int
) -> Step:
    """By how much what stands still moves in the picture from one frame to the next.

    Args:
        before, now: thumbnails of both frames.
        width, height: of the later frame in pixels.

    Returns:
        x and y in pixels of the frame; `STILL` where the frames differ in shape or have no
        common motion.
    """
    if before.shape != now.shape or min(now.shape) < 2:
        return STILL
    rows, columns = now.shape
    (x, y), peak = cv2.phaseCorrelate(
        before.astype(np.float32), now.astype(np.float32), _window(columns, rows)
    )
    # Written so that a peak that is not a number, as of frames of one colour, counts as none.
    if not peak >= LEAST_PEAK:
        return STILL
    pixel = 2 * _step(width, height)
    return x * pixel, y * pixel


@dataclass(frozen=True)
class Motion:
    """What is remembered of how one object moves.

    Four guesses are made of its next step: none; that of the camera; its own mean step in the
    picture; the camera's and its own mean step beside that.

    Attributes:
        errors: of each guess a mean of the last errors, in boxes; of an error along x and along y,
            the larger one counts.
        step: x and y of a mean of its last steps in the picture, in pixels a frame.
        own_step: the same with the camera's taken off.
    """

    # Plain numbers: there are few, and arrays of them would take a tenth of a millisecond.
    errors: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    step: Step = STILL
    own_step: Step = STILL

    def guesses(self, camera: Step) -> tuple[Step, ...]:
        """The four, in pixels.

        Args:
            camera: from `camera_motion`.
        """
        beside = camera[0] + self.own_step[0], camera[1] + self.own_step[1]
        return STILL, camera, self.step, beside

    def ahead(self, box_xyxy: Floats, camera: Step) -> Floats:
        """The box `[4]` to look about in this frame.

        Args:
            box_xyxy: `[4]`, of the frame before.
            camera: from `camera_motion`.
        """
        left, top, right, bottom = box_xyxy.tolist()
        weights = [1 / (error + ERROR_FLOOR) ** 2 for error in self.errors]
        guesses = self.guesses(camera)
        x = sum(w * guess[0] for w, guess in zip(weights, guesses, strict=True)) / sum(weights)
        y = sum(w * guess[1] for w, guess in zip(weights, guesses, strict=True)) / sum(weights)
        if max(abs(x) / (right - left), abs(y) / (bottom - top)) <= LEAST_SHIFT:
            return box_xyxy
        return np.array([left + x, top + y, right + x, bottom + y])

    def after(self, before_xyxy: Floats, found_xyxy: Floats, camera: Step) -> Motion:
        """What is remembered after one more frame in which the object was seen.

        Args:
            before_xyxy, found_xyxy: `[4]`, its boxes in the frame before and in this one.
            camera: from `camera_motion`.
        """
        left, top, right, bottom = before_xyxy.tolist()
        width, height = right - left, bottom - top
        left_now, top_now, right_now, bottom_now = found_xyxy.tolist()
        moved = (left_now + right_now - left - right) / 2, (top_now + bottom_now - top - bottom) / 2
        beside = moved[0] - camera[0], moved[1] - camera[1]
        wrong = [
            max(abs(x - moved[0]) / width, abs(y - moved[1]) / height)
            for x, y in self.guesses(camera)
        ]
        return Motion(
            errors=tuple(
                _blend(e, new, ERROR_RATE) for e, new in zip(self.errors, wrong, strict=True)
            ),
            step=(
                _blend(self.step[0], moved[0], STEP_RATE),
                _blend(self.step[1], moved[1], STEP_RATE),
            ),
            own_step=(
                _blend(self.own_step[0], beside[0], STEP_RATE),
                _blend(self.own_step[1], beside[1], STEP_RATE),
            ),
        )

    def unseen(self) -> Motion:
        """What is remembered after a frame in which it was lost: no step of its own."""
        return Motion(errors=self.errors)


def _blend(mean: float, newest: float, share: float) -> float:
    return (1 - share) * mean + share * newest


def _step(width: int, height: int) -> int:
    """Pixels of a frame from one that its thumbnail is made of to the next in a row."""
    return -(-max(width, height) // (2 * THUMBNAIL_SIDE))


@cache
def _even(length: int) -> int:
    """The largest even length, up to this one, that a Fourier transform takes without padding.

    Of odd ones, padded or not, `cv2.phaseCorrelate` tells a motion that is half a pixel off.
    """
    fitting = (n for n in range(2, length + 1, 2) if cv2.getOptimalDFTSize(n) == n)
    return max(fitting, default=1)


@cache
def _window(columns: int, rows: int) -> NDArray[np.float32]:
    """Fades out towards the border, which does not go on on the other side."""
    return np.asarray(cv2.createHanningWindow((columns, rows), cv2.CV_32F), dtype=np.float32)
