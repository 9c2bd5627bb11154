"""Several trackers over several data sets in one run, so that their figures can be compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from re3.data.sequence import Sequence
from re3.evaluation.metrics import Scores, score
from re3.evaluation.one_pass import Track, run_one_pass
from re3.evaluation.peers import TrackerInfo
from re3.evaluation.result_files import load_track, result_path, save_track


@dataclass(frozen=True, eq=False)
class SequenceResult:
    """One tracker on one sequence.

    Attributes:
        tracker: its name.
        sequence: what it ran on.
        track: what it gave.
        scores: how good that is.
        reused: read back from an earlier run's files; its times are of that run.
    """

    tracker: str
    sequence: Sequence
    track: Track
    scores: Scores
    reused: bool = False


@dataclass(frozen=True, eq=False)
class Progress:
    """Where a run is.

    Attributes:
        tracker: name of the tracker that is running.
        sequence: what it is running on.
        frames: how many frames of it are done.
        frames_before: how many frames of the whole run were done before this sequence.
        frames_total: frames of the whole run, over all trackers and sequences.
    """

    tracker: str
    sequence: Sequence
    frames: int
    frames_before: int
    frames_total: int


def run(
    trackers: list[TrackerInfo],
    sequences: list[Sequence],
    out: Path | None = None,
    resume: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> list[SequenceResult]:
    """Run every tracker over every sequence once.

    A tracker that fails on a sequence is scored with no box from there on, and the run goes on.

    Args:
        trackers: available ones, from `find_tracker`; names must differ.
        sequences: of any number of datasets; dataset and name together must differ.
        out: folder for the result boxes, see `re3.evaluation.result_files`; None keeps none.
        resume: take over complete results found in `out` in place of running again. Nothing
            checks that they came from the same version of the tracker.
        on_progress: called before each sequence and after each of its frames.

    Returns:
        the results, sequence by sequence, in the order of the trackers.

    Raises:
        ValueError: nothing to run, names that repeat, a tracker that is not available, frames
            that cannot be read, or results in `out` that belong to another clip.
    """
    _check(trackers, sequences, out, resume)
    total = len(trackers) * sum(map(len, sequences))
    done = 0
    results = []
    for sequence in sequences:
        for info in trackers:

            def report(
                frames: int,
                name: str = info.name,
                sequence: Sequence = sequence,
                before: int = done,
            ) -> None:
                if on_progress is not None:
                    on_progress(Progress(name, sequence, frames, before, total))

            report(0)
            results.append(_run_one(info, sequence, out, resume, report))
            done += len(sequence)
    return results


def _run_one(
    info: TrackerInfo,
    sequence: Sequence,
    out: Path | None,
    resume: bool,
    on_frame: Callable[[int], None],
) -> SequenceResult:
    path = None if out is None else result_path(out, info.name, sequence)
    track = load_track(path, sequence) if path is not None and resume else None
    reused = track is not None
    if track is None:
        assert info.factory is not None, "checked before the run"
        track = run_one_pass(info.factory, sequence, on_frame)
        if path is not None:
            save_track(path, track)
    scores = score(track.boxes_xywh, sequence.boxes_xywh)
    return SequenceResult(info.name, sequence, track, scores, reused)


def _check(
    trackers: list[TrackerInfo], sequences: list[Sequence], out: Path | None, resume: bool
) -> None:
    if not trackers or not sequences:
        raise ValueError(
            f"{len(trackers)} trackers and {len(sequences)} sequences; expected one or more of each"
        )
    if resume and out is None:
        raise ValueError("resume needs the folder with the earlier results; give it as out")
    for info in trackers:
        if info.factory is None:
            raise ValueError(f"tracker {info.name} is not available: {info.missing}")
    if name := _repeated(info.name for info in trackers):
        raise ValueError(
            f"two trackers are called {name!r}; give a model file a name of its own as "
            "NAME=MODEL.onnx"
        )
    if name := _repeated(f"{sequence.dataset}/{sequence.name}" for sequence in sequences):
        raise ValueError(
            f"two sequences are called {name!r}; expected different names: is a folder given "
            "twice, or do two datasets lie in folders of the same name?"
        )
    for sequence in sequences:
        if not sequence.annotated.any():
            raise ValueError(f"sequence {sequence.name!r} has no annotated frame to start at")
        if out is not None:
            result_path(out, trackers[0].name, sequence)


def _repeated(names: Iterable[str]) -> str | None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None
