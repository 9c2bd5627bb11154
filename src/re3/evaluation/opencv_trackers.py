"""OpenCV's trackers behind the protocol of `re3.evaluation.peers`.

OpenCV has two families. The one in `cv2` wants boxes of integers and raises where it cannot start;
the one in `cv2.legacy` takes floats and says False. Where an update says False the tracker gave
up on that frame: the box then stays where it was, with score 0, because a one-pass evaluation
needs a box in every frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Box = tuple[float, float, float, float]


class OpenCvTracker:
    """One of OpenCV's trackers; whatever it raises (`cv2.error`) passes through.

    Args:
        create: makes the tracker.
        whole_pixels: round the first box to integers, at least one pixel wide and high.
    """

    def __init__(self, create: Callable[[], Any], whole_pixels: bool = True) -> None:
        self._tracker = create()
        self._whole_pixels = whole_pixels
        self._box: Box = (0.0, 0.0, 0.0, 0.0)

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start at a box; see `re3.evaluation.peers.SequenceTracker`."""
        x, y, w, h = (float(value) for value in np.asarray(box_xywh))
        self._box = (x, y, w, h)
        # MOSSE learns its first filter from random warps: without a seed it finds the object on
        # one run and gives up on the next.
        cv2.setRNGSeed(0)
        if self._whole_pixels:
            started = self._tracker.init(
                frame, (round(x), round(y), max(round(w), 1), max(round(h), 1))
            )
        else:
            started = self._tracker.init(frame, (x, y, w, h))
        # The cv2 family returns nothing and raises instead.
        if started is False:
            raise RuntimeError(f"OpenCV's tracker cannot start at box {self._box}")

    def update(self, frame: NDArray[np.uint8]) -> tuple[Box, float]:
        """Follow into the next frame; the last box with score 0 where OpenCV gives up."""
        found, box = self._tracker.update(frame)
        if not found:
            return self._box, 0.0
        x, y, w, h = (float(value) for value in box)
        self._box = (x, y, w, h)
        # Only the network-based trackers have a score; the others know found or not found.
        score = getattr(self._tracker, "getTrackingScore", None)
        value = float(score()) if score is not None else 1.0
        return self._box, value if 0.0 <= value <= 1.0 else 1.0


def kcf() -> OpenCvTracker:
    """KCF (Henriques et al.) as OpenCV sets it: gives up below a response of 0.5."""
    return OpenCvTracker(cv2.TrackerKCF.create)


def kcf_persistent() -> OpenCvTracker:
    """KCF with `detect_thresh` 0, which never gives up."""
    parameters = cv2.TrackerKCF.Params()
    parameters.detect_thresh = 0.0
    return OpenCvTracker(lambda: cv2.TrackerKCF.create(parameters))


def csrt() -> OpenCvTracker:
    """CSR-DCF (Lukezic et al.)."""
    return OpenCvTracker(cv2.TrackerCSRT.create)


def mosse() -> OpenCvTracker:
    """MOSSE (Bolme et al.)."""
    return OpenCvTracker(cv2.legacy.TrackerMOSSE.create, whole_pixels=False)


def medianflow() -> OpenCvTracker:
    """MedianFlow (Kalal et al.)."""
    return OpenCvTracker(cv2.legacy.TrackerMedianFlow.create, whole_pixels=False)


def mil() -> OpenCvTracker:
    """MIL (Babenko et al.)."""
    return OpenCvTracker(cv2.TrackerMIL.create)


def tld() -> OpenCvTracker:
    """TLD (Kalal et al.)."""
    return OpenCvTracker(cv2.legacy.TrackerTLD.create, whole_pixels=False)


def boosting() -> OpenCvTracker:
    """Online AdaBoost (Grabner et al.)."""
    return OpenCvTracker(cv2.legacy.TrackerBoosting.create, whole_pixels=False)


def vit(model: Path) -> OpenCvTracker:
    """VitTrack, a small transformer, through `cv2.TrackerVit`."""
    parameters = cv2.TrackerVit.Params()
    parameters.net = str(model)
    with _warnings_off():
        return OpenCvTracker(lambda: cv2.TrackerVit.create(parameters))


def nanotrack(backbone: Path, head: Path) -> OpenCvTracker:
    """NanoTrack v1 or v2 through `cv2.TrackerNano`, which has settings of its own, fixed."""
    parameters = cv2.TrackerNano.Params()
    parameters.backbone = str(backbone)
    parameters.neckhead = str(head)
    with _warnings_off():
        return OpenCvTracker(lambda: cv2.TrackerNano.create(parameters))


@contextmanager
def _warnings_off() -> Iterator[None]:
    # OpenCV 5 warns at every TrackerNano that its engine ignores the default target.
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(min(level, logging.LOG_LEVEL_ERROR))
    try:
        yield
    finally:
        logging.setLogLevel(level)
