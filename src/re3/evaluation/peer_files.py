"""Peer trackers whose networks lie in files that do not come with re3."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from re3.evaluation import fear, nanotrack, opencv_trackers

PEERS_VARIABLE = "RE3_PEERS"
PEERS_FOLDER = Path("../shared/peers")
VIT_FILE = "object_tracking_vittrack_2023sep.onnx"


@dataclass(frozen=True)
class PeerFiles:
    """A tracker that is made of some files.

    Attributes:
        name, about: as `re3.evaluation.peers.TrackerInfo` has them.
        create: makes a tracker of the files' paths; can be pickled.
        files: in the folder of peers.
    """

    name: str
    about: str
    create: Callable[..., Any]
    files: tuple[str, ...]

    def factory(self, folder: Path | None) -> Callable[[], Any]:
        """What makes a tracker of the files in a folder of peers.

        Raises:
            FileNotFoundError: there is no such folder, or a file is not in it.
        """
        if folder is None:
            held = self.files[0].rpartition("/")[0] or self.files[0]
            raise FileNotFoundError(
                f"no folder of peer trackers; give one that holds {held} with --peers or "
                f"{PEERS_VARIABLE}"
            )
        paths = [folder / file for file in self.files]
        for path in paths:
            if not path.is_file():
                raise FileNotFoundError(f"{path} does not exist")
        return partial(self.create, *paths)


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
            f"{given} is not a folder; expected one with nanotrack/v2, nanotrack/v3 and fear "
            f"(--peers or {PEERS_VARIABLE})"
        )
    return given


def _nanotrack_v1(backbone: Path, head: Path) -> nanotrack.NanoTrack:
    return nanotrack.NanoTrack(backbone, head, nanotrack.V1)


def _nanotrack_v2(backbone: Path, head: Path) -> nanotrack.NanoTrack:
    return nanotrack.NanoTrack(backbone, head, nanotrack.V2)


def _nanotrack(name: str, version: str, runtime: str, create: Callable[..., Any]) -> PeerFiles:
    files = (f"nanotrack/{version}/nanotrack_{part}_sim.onnx" for part in ("backbone", "head"))
    return PeerFiles(name, f"NanoTrack {version} through {runtime}", create, tuple(files))


PEERS_WITH_FILES = (
    PeerFiles("vit", "OpenCV VitTrack", opencv_trackers.vit, (VIT_FILE,)),
    _nanotrack("nanotrack-v1-onnx", "v1", "ONNX Runtime", _nanotrack_v1),
    _nanotrack("nanotrack-v2", "v2", "OpenCV", opencv_trackers.nanotrack),
    _nanotrack("nanotrack-v2-onnx", "v2", "ONNX Runtime", _nanotrack_v2),
    _nanotrack("nanotrack-v3", "v3", "ONNX Runtime", nanotrack.NanoTrack),
    PeerFiles(
        "fear-xs",
        "FEAR-XS through ONNX Runtime, one thread",
        fear.FearXs,
        ("fear/fear_xs_template.onnx", "fear/fear_xs_search.onnx"),
    ),
)
"""All of them, in the order of the list."""
