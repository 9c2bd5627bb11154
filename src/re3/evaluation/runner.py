"""Several trackers over several data sets in one run, so that their figures can be compared."""

from __future__ import annotations

import glob
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from re3.data.sequence import Sequence
from re3.evaluation.peers import TrackerInfo, seeded_factory
from re3.evaluation.published import published_track
from re3.evaluation.result_files import (
    load_supervised,
    load_track,
    partial_path,
    result_path,
    save_supervised,
    save_track,
)
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.supervised import SupervisedConfig, SupervisedTrack
from re3.evaluation.task import Given, Task, run_task
from re3.evaluation.workers import WorkerPool

__all__ = ["Progress", "SequenceResult", "run"]

TIMEOUT = 30.0
"""Seconds a tracker may take for a frame, by default."""


@dataclass(frozen=True, eq=False)
class Progress:
    """Where a run is.

    Attributes:
        tracker: name of the tracker that is running.
        sequence: what it is running on.
        frames: how many frames of it are done.
        frames_before: how many frames of the whole run are done besides those.
        frames_total: frames of the whole run, over all trackers, sequences and repetitions.
        repeat: which repetition it is, from 0.
        ended: this sequence is done, or has failed.
    """

    tracker: str
    sequence: Sequence
    frames: int
    frames_before: int
    frames_total: int
    repeat: int = 0
    ended: bool = False


@dataclass(frozen=True, eq=False)
class _Job:
    """One tracker, one sequence, one repetition; `path` is that of its result file."""

    info: TrackerInfo
    sequence: Sequence
    repeat: int
    path: Path | None


def run(
    trackers: list[TrackerInfo],
    sequences: list[Sequence],
    out: Path | None = None,
    resume: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    *,
    supervised: SupervisedConfig | None = None,
    repeats: int = 1,
    jobs: int = 0,
    timeout: float = TIMEOUT,
    otb_rules: bool = False,
) -> list[SequenceResult]:
    """Run every tracker over every sequence.

    What fails, a tracker or a sequence, is said in the result's `track.failure`, and the run goes
    on. A tracker that fails is scored with no box from there on; where the sequence is at fault
    (frames that cannot be read, no truth) the scores are undefined.

    Args:
        trackers: available ones, from `find_tracker`; names must differ.
        sequences: of any number of datasets; dataset and name together must differ.
        out: folder for the result boxes, see `re3.evaluation.result_files`; None keeps none. Each
            frame is written as it comes, to a hidden file beside the final one.
        resume: take over complete results found in `out` in place of running again. Nothing
            checks that they came from the same version of the tracker.
        on_progress: called before each sequence, while it runs, and when it has ended.
        supervised: when to start a tracker again that has lost the object; None for one pass.
        repeats: how often each tracker runs over each sequence.
        jobs: how many run at the same time, each in a process of its own; the boxes do not depend
            on it, the times do. 0 runs them one after the other in this process, where one that
            hangs cannot be stopped.
        timeout: seconds a tracker may take for a frame before its process is stopped.
        otb_rules: count frames as OTB's toolkit does; of one pass.

    Returns:
        the results, sequence by sequence, in the order of the trackers, then of the repetitions.

    Raises:
        ValueError: nothing to run, names that repeat, a tracker that is not available or cannot
            run this way, or results in `out` that belong to another clip.
    """
    _check(trackers, sequences, out, resume, supervised, repeats)
    planned = [
        _Job(
            info,
            sequence,
            repeat,
            None if out is None else result_path(out, info.name, sequence, repeat),
        )
        for sequence in sequences
        for info in trackers
        for repeat in range(repeats)
    ]
    results: dict[int, SequenceResult] = {}
    told = _Teller(planned, on_progress)
    for index, job in enumerate(planned):
        _clear_after_kill(job)
        if (given := _at_hand(job, supervised, resume)) is not None:
            results[index] = _result(job, given, otb_rules, reused=job.info.published is None)
            told.ended(index)
    open_jobs = [index for index in range(len(planned)) if index not in results]
    for index, given in _run_jobs(planned, open_jobs, supervised, jobs, timeout, told):
        job = planned[index]
        if job.path is not None:
            _save(job.path, given)
        results[index] = _result(job, given, otb_rules)
        told.ended(index)
    return [results[index] for index in range(len(planned))]


class _Teller:
    """Tells of progress over jobs that may run at the same time."""

    def __init__(self, jobs: list[_Job], on_progress: Callable[[Progress], None] | None) -> None:
        self._jobs = jobs
        self._on_progress = on_progress
        self._done = [0] * len(jobs)
        self._total = sum(len(job.sequence) for job in jobs)

    def frames(self, index: int, frames: int, ended: bool = False) -> None:
        self._done[index] = frames
        if self._on_progress is not None:
            job, before = self._jobs[index], sum(self._done) - frames
            self._on_progress(
                Progress(
                    job.info.name, job.sequence, frames, before, self._total, job.repeat, ended
                )
            )

    def ended(self, index: int) -> None:
        # A failed one has no frames left to do.
        self.frames(index, len(self._jobs[index].sequence), ended=True)


def _run_jobs(
    planned: list[_Job],
    indices: list[int],
    supervised: SupervisedConfig | None,
    jobs: int,
    timeout: float,
    told: _Teller,
) -> Iterator[tuple[int, Given]]:
    """Run some of the jobs; gives the index of each and its track, as they end."""
    with ExitStack() as stack:
        scratch: Path | None = None
        if jobs and any(planned[index].path is None for index in indices):
            scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="re3-eval-")))
        tasks = [_task(planned[index], supervised, index, scratch) for index in indices]
        if jobs == 0:
            for index, task in zip(indices, tasks, strict=True):
                told.frames(index, 0)
                yield index, run_task(task, partial(told.frames, index))
                _clear(task)
            return
        pool = stack.enter_context(WorkerPool(jobs, timeout))
        for place, given in pool.run(tasks, lambda place, done: told.frames(indices[place], done)):
            yield indices[place], given
            _clear(tasks[place])


def _task(job: _Job, supervised: SupervisedConfig | None, index: int, scratch: Path | None) -> Task:
    journal = None
    if job.path is not None:
        journal = partial_path(job.path, "journal")
    elif scratch is not None:
        journal = scratch / f"{index}.journal"
    factory = seeded_factory(job.info, job.repeat)
    return Task(factory, job.sequence, supervised, journal, seed=job.repeat)


def _clear_after_kill(job: _Job) -> None:
    """Remove what an earlier run that was killed left beside the results, of finished jobs too."""
    if job.path is not None:
        for kind in ("journal", "partial"):
            for stale in job.path.parent.glob(f".{glob.escape(job.path.name)}.*.{kind}"):
                stale.unlink(missing_ok=True)


def _clear(task: Task) -> None:
    if task.journal is not None:
        task.journal.unlink(missing_ok=True)


def _at_hand(job: _Job, supervised: SupervisedConfig | None, resume: bool) -> Given | None:
    """What need not be run: published boxes, or the complete results of an earlier run."""
    if job.info.published is not None:
        return published_track(job.info.published, job.sequence, job.info.first_pixel)
    if not resume or job.path is None or not job.sequence.annotated.any():
        return None
    if supervised is None:
        return load_track(job.path, job.sequence)
    return load_supervised(job.path, job.sequence)


def _save(path: Path, given: Given) -> None:
    """Keep what is worth keeping: of a failed run, one pass up to the failure."""
    if isinstance(given, SupervisedTrack):
        if given.failure is None:
            save_supervised(path, given)
    elif not given.unscored:
        save_track(path, given)


def _result(job: _Job, given: Given, otb_rules: bool, reused: bool = False) -> SequenceResult:
    return SequenceResult.of(
        job.info.name, job.sequence, given, reused, job.repeat, otb_rules=otb_rules
    )


def _check(
    trackers: list[TrackerInfo],
    sequences: list[Sequence],
    out: Path | None,
    resume: bool,
    supervised: SupervisedConfig | None,
    repeats: int,
) -> None:
    if not trackers or not sequences:
        raise ValueError(
            f"{len(trackers)} trackers and {len(sequences)} sequences; expected one or more of each"
        )
    if repeats < 1:
        raise ValueError(f"repeats is {repeats}; expected 1 or more")
    if resume and out is None:
        raise ValueError("resume needs the folder with the earlier results; give it as out")
    for info in trackers:
        if info.published is not None:
            if supervised is not None:
                raise ValueError(
                    f"{info.name} is published boxes of one pass, which cannot be started again; "
                    "leave it out, or take the protocol ope or imagenet-vid"
                )
        elif info.factory is None:
            raise ValueError(f"tracker {info.name} is not available: {info.missing}")
    if name := _repeated(info.name for info in trackers):
        raise ValueError(
            f"two trackers are called {name!r}; give one a name of its own as NAME=TRACKER"
        )
    if name := _repeated(f"{sequence.dataset}/{sequence.name}" for sequence in sequences):
        raise ValueError(
            f"two sequences are called {name!r}; expected different names: is a folder given "
            "twice, or do two datasets lie in folders of the same name?"
        )


def _repeated(names: Iterable[str]) -> str | None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None
