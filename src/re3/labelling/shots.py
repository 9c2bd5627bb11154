"""Videos as shots: frames between two cuts, thinned out and scaled."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Several
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.labelling.config import LabelConfig
from re3.video import open_source

CUT_SIZE = (48, 32)
CUT = 18.0
"""Mean difference of grey levels, of 255, from which two frames may be on either side of a cut."""
CUT_FACTOR = 4.0
"""How many times the median difference before it that of a cut is at least."""
CUT_MEMORY = 8
"""Frames that this median is taken of."""


# Without eq=False the generated __eq__ would compare arrays and fail on their truth value.
@dataclass(frozen=True, eq=False)
class Shot:
    """Frames of a video without a cut, thinned out and scaled.

    Attributes:
        frames: uint8 `[H, W, 3]` BGR, of one size with even sides, T of them.
        indices: int `[T]`, of the frames in the video.
        scale: pixels of these frames per pixel of the video.
    """

    frames: Several[NDArray[np.uint8]]
    indices: NDArray[np.int64]
    scale: float


class ShotReader:
    """The shots of a video, each as long as a track may be at most.

    Args:
        source: as `re3.video.open_source` takes it.
        config: frame rate, size and longest track.
        start_frame: frames before this one are skipped.

    Attributes:
        step: frames of the video from one that is used to the next.
        fps: of the shots.

    Raises:
        SourceError: it cannot be opened.
    """

    def __init__(self, source: str | Path, config: LabelConfig, start_frame: int = 0) -> None:
        self._source, self._config, self._start = source, config, start_frame
        with open_source(source, start_frame=start_frame) as video:
            self.step = max(1, round(float(video.fps) / config.fps))
            self.fps = Fraction(video.fps) / self.step

    def shots(self) -> Iterator[Shot]:
        """The shots of the shortest track's length and more, in order.

        Raises:
            SourceError: the video is broken.
        """
        frames: list[NDArray[np.uint8]] = []
        indices: list[int] = []
        differences: list[float] = []
        last: NDArray[np.float64] | None = None
        scale = 1.0
        with open_source(self._source, start_frame=self._start) as video:
            for frame in video:
                if (frame.index - self._start) % self.step:
                    continue
                image, scale = _scaled(frame.image, self._config.side)
                grey = _small_grey(image)
                difference = 0.0 if last is None else float(np.abs(grey - last).mean())
                resized = bool(frames) and frames[0].shape != image.shape
                if (
                    resized
                    or len(frames) == self._config.longest
                    or _is_cut(difference, differences)
                ):
                    if len(frames) >= self._config.shortest:
                        yield Shot(frames, np.array(indices), scale)
                    frames, indices, differences = [], [], []
                elif frames:
                    differences.append(difference)
                frames.append(image)
                indices.append(frame.index)
                last = grey
        if len(frames) >= self._config.shortest:
            yield Shot(frames, np.array(indices), scale)


def _is_cut(difference: float, before: list[float]) -> bool:
    usual = float(np.median(before[-CUT_MEMORY:])) if before else 0.0
    return difference > CUT and bool(before) and difference > CUT_FACTOR * usual + 4.0


def _small_grey(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return cv2.resize(grey, CUT_SIZE, interpolation=cv2.INTER_AREA).astype(np.float64)


def _scaled(image: NDArray[np.uint8], side: int) -> tuple[NDArray[np.uint8], float]:
    """The image with a longer side of at most `side` and even sides, and its scale."""
    height, width = image.shape[:2]
    scale = min(1.0, side / max(height, width))
    if scale < 1:
        size = (max(2, round(width * scale)), max(2, round(height * scale)))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    return np.ascontiguousarray(image[:height, :width]), scale
