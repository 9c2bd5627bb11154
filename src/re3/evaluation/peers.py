"""The trackers that can be evaluated: ours, those it is compared with, and the floors.

A *tracker* here is anything with the two methods of `SequenceTracker`; a factory makes a fresh one
for each sequence. Trackers are asked for by name:

* the name of a model in `re3.models`, or the path of a model file, is ours, with options after it
  (`re3-lite@no-reset`, see `re3.evaluation.our_tracker`);
* `opencv:NAME` and `nanotrack:VERSION` are other names of what `available_trackers` lists;
* `trax:COMMAND` is a program that speaks TraX, the protocol of the VOT toolkit;
* `python:package.module:Class` is any Python object with `init` and `update`;
* `published:FOLDER` are boxes that others published, shown without running anything;
* `NAME=` before any of these gives it a name of its own in the report.

The files of NanoTrack, FEAR-XS and VitTrack do not come with re3. They are looked for in
`nanotrack/<version>`, in `fear` and as `object_tracking_vittrack_2023sep.onnx` in a folder given by
the user, the environment variable `RE3_PEERS`, or `../shared/peers`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.evaluation import opencv_trackers
from re3.evaluation.floors import FirstBox, RandomWalk
from re3.evaluation.our_tracker import OurTracker, split_options
from re3.evaluation.peer_files import PEERS_WITH_FILES, PeerFiles, peers_folder
from re3.evaluation.python_trackers import PythonTracker, find_class
from re3.models import find_weights, list_models

MODEL_SUFFIXES = (".onnx", ".safetensors")
FIRST_BOX = "first-box"

ALIASES = {
    **{
        f"opencv:{name}": name
        for name in ("kcf", "kcf-persistent", "csrt", "mil", "mosse", "medianflow", "tld")
    },
    "opencv:boosting": "boosting",
    "opencv:vit": "vit",
    "opencv:nano": "nanotrack-v2",
    "nanotrack:v1": "nanotrack-v1-onnx",
    "nanotrack:v2": "nanotrack-v2-onnx",
    "nanotrack:v3": "nanotrack-v3",
}
"""Other names of trackers: what is asked for -> its name in the list and in reports."""

_PREFIXED = re.compile(
    r"(?:(?P<name>[^:]+)=)?(?P<kind>trax|python|published|opencv|nanotrack):(?P<rest>.+)",
    re.DOTALL,
)


class SequenceTracker(Protocol):
    """A tracker of one object, frame by frame; boxes are xywh in pixels, 0-based."""

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start on a frame uint8 `[H, W, 3]` BGR with the object at a box `[4]`."""

    def update(self, frame: NDArray[np.uint8]) -> tuple[ArrayLike, float]:
        """The object's box `[4]` in the next frame and a score, 0..1."""


TrackerFactory = Callable[[], SequenceTracker]


@dataclass(frozen=True)
class TrackerInfo:
    """A tracker by name.

    Attributes:
        name: as it is asked for and reported.
        about: what it is, in a line.
        factory: makes a fresh one; None where it is not available, or not run. To be run in a
            process of its own it must be one that can be pickled.
        missing: why it is not available; None where it is.
        seeded: the tracker draws numbers, and its factory takes their `seed`.
        published: folder of published boxes, which are shown in place of running anything.
        first_pixel: what published boxes call the first column and row of an image, 0 or 1.
    """

    name: str
    about: str
    factory: Callable[..., SequenceTracker] | None
    missing: str | None = None
    seeded: bool = False
    published: Path | None = None
    first_pixel: int = 0


def seeded_factory(info: TrackerInfo, seed: int) -> TrackerFactory:
    """The factory of an available tracker, for one repetition of a run."""
    assert info.factory is not None, "only available trackers are run"
    return partial(info.factory, seed=seed) if info.seeded else info.factory


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
        TrackerInfo("random-walk", "the box moves by chance, seeded", RandomWalk, seeded=True),
        TrackerInfo("kcf", "OpenCV KCF, default: gives up when unsure", opencv_trackers.kcf),
        TrackerInfo(
            "kcf-persistent",
            "OpenCV KCF with detect_thresh 0: never gives up",
            opencv_trackers.kcf_persistent,
        ),
        TrackerInfo("csrt", "OpenCV CSRT", opencv_trackers.csrt),
        TrackerInfo("mil", "OpenCV MIL", opencv_trackers.mil),
        TrackerInfo("mosse", "OpenCV MOSSE", opencv_trackers.mosse),
        TrackerInfo("medianflow", "OpenCV MedianFlow", opencv_trackers.medianflow),
        TrackerInfo("tld", "OpenCV TLD", opencv_trackers.tld),
        TrackerInfo("boosting", "OpenCV Boosting", opencv_trackers.boosting),
        *(_peer_info(peer, folder) for peer in PEERS_WITH_FILES),
    ]


def find_tracker(asked: str, peers: Path | None = None) -> TrackerInfo:
    """The tracker asked for by name, see the head of this module.

    Raises:
        ValueError: no such tracker, or it is not available here; says which are.
        FileNotFoundError: the model file does not exist.
        NotADirectoryError: `peers`, `RE3_PEERS` or a folder of published boxes is not a folder.
    """
    match = _PREFIXED.fullmatch(asked)
    if match is not None:
        info = _find_prefixed(match["kind"], match["rest"], peers)
        return replace(info, name=match["name"]) if match["name"] else info
    # The last sign counts: names may have some, model files seldom do.
    label, equals, spec = asked.rpartition("=")
    model, options = split_options(spec)
    if model.lower().endswith(MODEL_SUFFIXES):
        if not Path(model).is_file():
            raise FileNotFoundError(f"{model} does not exist; expected a model file")
        default = spec.replace(model, Path(model).stem, 1)
        info = TrackerInfo(default, f"the model in {model}", partial(OurTracker, model))
    else:
        info = _find_known(model, peers)
        if model != spec and not _is_model(model):
            raise ValueError(
                f"{spec!r}: options after @ are for our models only; expected {model!r}"
            )
        info = replace(info, name=spec)
    if model != spec:
        info = replace(info, factory=partial(OurTracker, model, options))
    return replace(info, name=label) if equals else info


def _find_known(name: str, peers: Path | None) -> TrackerInfo:
    known = {info.name: info for info in available_trackers(peers)}
    if name not in known:
        raise ValueError(
            f"no tracker is called {name!r}; expected a model file "
            f"({' or '.join(MODEL_SUFFIXES)}), trax:COMMAND, python:MODULE:CLASS, "
            f"published:FOLDER or one of {', '.join(known)}"
        )
    if known[name].missing is not None:
        raise ValueError(f"tracker {name} is not available: {known[name].missing}")
    return known[name]


def _find_prefixed(kind: str, rest: str, peers: Path | None) -> TrackerInfo:
    asked = f"{kind}:{rest}"
    if kind == "trax":
        try:
            from re3.evaluation.trax import import_trax

            import_trax()
        except ImportError as error:
            raise ValueError(f"tracker {asked} is not available: {error}") from error
        return TrackerInfo(_slug(asked), f"TraX: {rest}", partial(_trax, rest))
    if kind == "python":
        find_class(rest)
        name = rest.rpartition(":")[2]
        return TrackerInfo(name, f"the Python class {rest}", partial(PythonTracker, rest))
    if kind == "published":
        folder = Path(rest)
        if not folder.is_dir():
            raise NotADirectoryError(
                f"{folder} is not a folder; expected one with published boxes, SEQUENCE.txt"
            )
        about = f"published boxes in {folder}, not run"
        return TrackerInfo(folder.resolve().name, about, None, published=folder)
    if asked not in ALIASES:
        names = ", ".join(alias for alias in ALIASES if alias.startswith(f"{kind}:"))
        raise ValueError(f"no tracker is called {asked!r}; expected one of {names}")
    return _find_known(ALIASES[asked], peers)


def _trax(command: str) -> SequenceTracker:
    from re3.evaluation.trax import TraxTracker

    return TraxTracker(command)


def _slug(text: str) -> str:
    """A name fit for a file, of whatever text."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", text).strip("-.")


def _is_model(name: str) -> bool:
    return any(card.name == name for card in list_models())


def _model_info(name: str, about: str) -> TrackerInfo:
    try:
        find_weights(name)
    except ValueError as error:
        return TrackerInfo(name, about, None, str(error))
    return TrackerInfo(name, about, partial(OurTracker, name))


def _peer_info(peer: PeerFiles, folder: Path | None) -> TrackerInfo:
    try:
        return TrackerInfo(peer.name, peer.about, peer.factory(folder))
    except FileNotFoundError as error:
        return TrackerInfo(peer.name, peer.about, None, str(error))
