"""The trackers that can be evaluated: ours, those it is compared with, and the floor.

A *tracker* here is anything with the two methods of `SequenceTracker`; a factory makes a fresh one
for each sequence. Trackers are asked for by name:

* the name of a model in `re3.models`, or the path of a model file, is ours;
* `NAME=PATH` gives such a file a name of its own in the report;
* everything else is in the list of `available_trackers`.

NanoTrack's files do not come with re3. They are looked for in `nanotrack/<version>` of a folder
given by the user, the environment variable `RE3_PEERS`, or `../shared/peers`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.evaluation import nanotrack, opencv_trackers
from re3.models import find_weights, list_models

MODEL_SUFFIXES = (".onnx", ".safetensors")
FIRST_BOX = "first-box"
PEERS_VARIABLE = "RE3_PEERS"
PEERS_FOLDER = Path("../shared/peers")


class SequenceTracker(Protocol):
    """A tracker of one object, frame by frame; boxes are xywh in pixels, 0-based."""

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start on a frame uint8 `[H, W, 3]` BGR with the object at a box `[4]`."""

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The object's box `[4]` in the next frame and a score, 0..1."""


TrackerFactory = Callable[[], SequenceTracker]


class FirstBox:
    """The floor: the object stays where it was."""

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Keep the box."""
        self._box = np.array(box_xywh, dtype=np.float64)

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The first box, score 1."""
        return self._box, 1.0


class OurTracker:
    """`re3.Tracker` with a shipped model or a model file.

    Args:
        model: name of a model or path of a model file, as `re3.Tracker` takes it.
    """

    def __init__(self, model: str) -> None:
        # Deferred: the peers can be evaluated without loading a network.
        from re3.tracker import Tracker

        self._tracker = Tracker(model=model)

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start at a box."""
        self._tracker.init(frame, box_xywh)

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The box and its score."""
        result = self._tracker.update(frame)
        return result.box_xywh, result.score


@dataclass(frozen=True)
class TrackerInfo:
    """A tracker by name.

    Attributes:
        name: as it is asked for and reported.
        about: what it is, in a line.
        factory: makes a fresh one; None where it is not available.
        missing: why it is not available; None where it is.
    """

    name: str
    about: str
    factory: TrackerFactory | None
    missing: str | None = None


def available_trackers(peers: Path | None = None) -> list[TrackerInfo]:
    """Every tracker known by name, with the reason where one cannot run here.

    Args:
        peers: folder with the files of peer trackers; None looks in the places named above.

    Raises:
        NotADirectoryError: `peers`, or `RE3_PEERS`, is not a folder.
    """
    folder = peers_folder(peers)
    return [
        *(_model_info(card.name, card.description) for card in list_models()),
        TrackerInfo(FIRST_BOX, "the first box for ever: the floor", FirstBox),
        TrackerInfo("kcf", "OpenCV KCF, default: gives up when unsure", opencv_trackers.kcf),
        TrackerInfo(
            "kcf-persistent",
            "OpenCV KCF with detect_thresh 0: never gives up",
            opencv_trackers.kcf_persistent,
        ),
        TrackerInfo("csrt", "OpenCV CSRT", opencv_trackers.csrt),
        TrackerInfo("mosse", "OpenCV MOSSE", opencv_trackers.mosse),
        TrackerInfo("medianflow", "OpenCV MedianFlow", opencv_trackers.medianflow),
        _nanotrack_info("v2", "NanoTrack v2 through OpenCV", opencv_trackers.nanotrack, folder),
        _nanotrack_info("v3", "NanoTrack v3 through ONNX Runtime", nanotrack.NanoTrack, folder),
    ]


def find_tracker(asked: str, peers: Path | None = None) -> TrackerInfo:
    """The tracker asked for by name, see the head of this module.

    Raises:
        ValueError: no such tracker, or it is not available here; says which are.
        FileNotFoundError: the model file does not exist.
        NotADirectoryError: `peers`, or `RE3_PEERS`, is not a folder.
    """
    label, equals, path = asked.rpartition("=")
    if path.lower().endswith(MODEL_SUFFIXES):
        if not Path(path).is_file():
            raise FileNotFoundError(f"{path} does not exist; expected a model file")
        name = label if equals else Path(path).stem
        return TrackerInfo(name, f"the model in {path}", partial(OurTracker, path))
    known = {info.name: info for info in available_trackers(peers)}
    if asked not in known:
        raise ValueError(
            f"no tracker is called {asked!r}; expected a model file "
            f"({' or '.join(MODEL_SUFFIXES)}) or one of {', '.join(known)}"
        )
    if known[asked].missing is not None:
        raise ValueError(f"tracker {asked} is not available: {known[asked].missing}")
    return known[asked]


def peers_folder(given: Path | None = None) -> Path | None:
    """The folder with peer trackers' files: as given, by environment, by default, or None.

    Raises:
        NotADirectoryError: the folder given, or the environment's, is not one.
    """
    if given is None and os.environ.get(PEERS_VARIABLE):
        given = Path(os.environ[PEERS_VARIABLE])
    if given is None:
        return PEERS_FOLDER if PEERS_FOLDER.is_dir() else None
    if not given.is_dir():
        raise NotADirectoryError(
            f"{given} is not a folder; expected one with nanotrack/v2 and nanotrack/v3 "
            f"(--peers or {PEERS_VARIABLE})"
        )
    return given


def _model_info(name: str, about: str) -> TrackerInfo:
    try:
        find_weights(name)
    except ValueError as error:
        return TrackerInfo(name, about, None, str(error))
    return TrackerInfo(name, about, partial(OurTracker, name))


def _nanotrack_info(
    version: str,
    about: str,
    create: Callable[[Path, Path], SequenceTracker],
    folder: Path | None,
) -> TrackerInfo:
    name = f"nanotrack-{version}"
    if folder is None:
        reason = (
            f"no folder of peer trackers; give one that holds nanotrack/{version} with --peers "
            f"or {PEERS_VARIABLE}"
        )
        return TrackerInfo(name, about, None, reason)
    files = [
        folder / "nanotrack" / version / f"nanotrack_{part}_sim.onnx"
        for part in ("backbone", "head")
    ]
    for file in files:
        if not file.is_file():
            return TrackerInfo(name, about, None, f"{file} does not exist")
    return TrackerInfo(name, about, partial(create, *files))
