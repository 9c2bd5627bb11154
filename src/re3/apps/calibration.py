"""Steps of real tracks, from which a network in eight bits takes the ranges of its values."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from re3.data.formats import read_dataset
from re3.data.sequence import Sequence
from re3.engine import Engine, StepOutput, load_engine
from re3.network.export import export_onnx
from re3.network.lite_config import LiteState
from re3.network.re3_lite import Re3Lite
from re3.tracker import MultiTracker
from re3.video import SourceError, open_source

CLIPS = 48
"""At most so many tracks, drawn from all by chance."""

STEPS = (1, 2, 9, 20, 33)
"""Which steps of a track are kept: the first, early ones, and those about a reset."""


class _Recorder:
    """An engine that keeps what goes into some steps of each track."""

    def __init__(self, engine: Engine) -> None:
        self._engine, self.spec = engine, engine.spec
        self.kept: list[tuple[Tensor, LiteState]] = []
        self.count = 0

    def step(
        self,
        previous_crops: NDArray[np.uint8] | None,
        current_crops: NDArray[np.uint8],
        state: Mapping[str, NDArray[np.float32]],
    ) -> StepOutput:
        """See `re3.engine.base.Engine.step`."""
        self.count += 1
        if self.count in STEPS:
            before = LiteState(**{k: torch.from_numpy(v.copy()) for k, v in state.items()})
            self.kept.append((torch.from_numpy(current_crops.copy()), before))
        return self._engine.step(previous_crops, current_crops, state)


def recorded_steps(network: Re3Lite, folders: list[Path]) -> Iterator[tuple[Tensor, LiteState]]:
    """Track some of the clips in folders, and give what the network got.

    Args:
        network: in full precision.
        folders: with annotated clips in any format that `re3 eval` reads.

    Raises:
        ValueError, OSError: no clips there, or they cannot be read.
    """
    found = [s for folder in folders for s in read_dataset(folder, training=True)]
    tracks = [sequence for sequence in found if sequence.annotated.any()]
    if not tracks:
        raise ValueError(f"{', '.join(map(str, folders))}: no annotated clips to calibrate on")
    chosen = np.random.default_rng(0).permutation(len(tracks))[:CLIPS]
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "network.onnx"
        export_onnx(network, path)
        engine = load_engine(path)
    for index in chosen:
        recorder = _Recorder(engine)
        _track(tracks[index], recorder)
        yield from recorder.kept


def _track(sequence: Sequence, engine: Engine) -> None:
    first = int(np.argmax(sequence.annotated))
    tracker = MultiTracker(engine=engine, search=False)
    try:
        with open_source(sequence.source, start_frame=sequence.start_frame + first) as source:
            for count, frame in enumerate(source):
                if count == 0:
                    tracker.add(frame.image, sequence.boxes_xywh[first])
                else:
                    tracker.update(frame.image)
                if count == max(STEPS):
                    return
    except SourceError as error:
        raise ValueError(f"sequence {sequence.name!r}: {error}") from error
