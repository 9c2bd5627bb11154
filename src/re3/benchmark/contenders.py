"""What is measured: our tracker by model, engine and threads, and the trackers beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.benchmark.footage import Box
from re3.cores import usable_cores
from re3.engine import find_file, load_engine
from re3.engine.threads import usable_threads
from re3.evaluation.one_pass import close
from re3.evaluation.peers import SequenceTracker, find_tracker
from re3.model_spec import DATA_SUFFIX
from re3.timed_tracker import TimedMultiTracker, TimeSpent, time_spent

Frame = NDArray[np.uint8]


class Contender(Protocol):
    """Follows any number of objects at once."""

    def start(self, frame: Frame, boxes_xywh: Sequence[Box]) -> None:
        """Start anew with these objects."""

    def update(self, frame: Frame) -> None:
        """Follow them into the next frame."""

    @property
    def time_spent(self) -> TimeSpent:
        """Where the time of the latest update went; NaN of one that does not tell."""


@dataclass(frozen=True)
class Entry:
    """A contender by name, to be made here or in a process of its own.

    Attributes:
        name: in tables and plots.
        ours: it is a model of ours; the rest says which, and how it is run.
        model: name or file of our model, or name of a peer.
        engine: of our model.
        threads: that it may use; 0 for what a tracker of ours takes by itself. Peers run with
            OpenCV's.
        peer_files: folder with the files of peers; None for the usual places.
    """

    name: str
    ours: bool
    model: str
    engine: str = "auto"
    threads: int = 0
    peer_files: Path | None = None

    def make(self) -> Contender:
        """The contender, its model loaded.

        Raises:
            Whatever `load_engine` and `find_tracker` raise.
        """
        return _Ours(self) if self.ours else _Peer(self)

    @property
    def size_bytes(self) -> int:
        """Of the model's files; 0 of a tracker without any."""
        if self.ours:
            file = find_file(self.model, self.engine)[0]
            apart = file.with_name(file.name + DATA_SUFFIX)  # large weights of an ONNX graph
            return sum(path.stat().st_size for path in (file, apart) if path.is_file())
        made_of = getattr(find_tracker(self.model, self.peer_files).factory, "args", ())
        return sum(file.stat().st_size for file in made_of if isinstance(file, Path))


def our_entries(
    models: Sequence[str], engines: Sequence[str], threads: Sequence[int]
) -> list[Entry]:
    """Every model with every engine and number of threads; the name says only what differs."""
    entries = []
    for model in models:
        for engine in engines:
            for number in threads:
                name = Path(model).stem if model.endswith((".onnx", ".safetensors")) else model
                if len(engines) > 1 or engine != "auto":
                    name += f" {engine}"
                if len(threads) > 1 or number:
                    name += f" {number or usable_threads()}t"
                entries.append(Entry(name, True, model, engine, number))
    return entries


class _Ours:
    """`re3.MultiTracker` with a clock."""

    def __init__(self, entry: Entry) -> None:
        self._entry = entry
        self._engine = load_engine(entry.model, entry.engine, entry.threads)
        self._tracker = self._fresh()

    def _fresh(self) -> TimedMultiTracker:
        # The search for lost objects adds crops when it runs: the plain step is what is measured.
        return TimedMultiTracker(engine=self._engine, search=False)

    def start(self, frame: Frame, boxes_xywh: Sequence[Box]) -> None:
        _set_threads(self._entry)
        self._tracker = self._fresh()
        for box in boxes_xywh:
            self._tracker.add(frame, box)

    def update(self, frame: Frame) -> None:
        self._tracker.update(frame)

    @property
    def time_spent(self) -> TimeSpent:
        return time_spent(self._tracker)


class _Peer:
    """A tracker of one object, one for each."""

    def __init__(self, entry: Entry) -> None:
        factory = find_tracker(entry.model, entry.peer_files).factory
        if factory is None:
            raise ValueError(f"{entry.model} is not run, so that its speed cannot be measured")
        self._entry = entry
        self._factory: Callable[[], SequenceTracker] = factory
        self._trackers: list[SequenceTracker] = []

    def start(self, frame: Frame, boxes_xywh: Sequence[Box]) -> None:
        _set_threads(self._entry)
        for tracker in self._trackers:
            close(tracker)
        self._trackers = [self._factory() for _ in boxes_xywh]
        for tracker, box in zip(self._trackers, boxes_xywh, strict=True):
            tracker.init(frame, box)

    def update(self, frame: Frame) -> None:
        for tracker in self._trackers:
            tracker.update(frame)

    @property
    def time_spent(self) -> TimeSpent:
        return time_spent(None)


def _set_threads(entry: Entry) -> None:
    """Libraries whose number of threads is the whole process's, as this entry wants it."""
    cv2.setNumThreads(entry.threads or usable_cores())
    if entry.engine == "torch":
        import torch

        torch.set_num_threads(entry.threads or usable_cores())
