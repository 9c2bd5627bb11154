"""One tracker over one sequence, whatever goes wrong."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from re3.data.sequence import Sequence
from re3.evaluation.frame_log import FrameLog, Step
from re3.evaluation.one_pass import Track, UnreadableFrames, run_one_pass, told
from re3.evaluation.peers import SequenceTracker, TrackerFactory
from re3.evaluation.supervised import SupervisedConfig, SupervisedTrack, run_supervised

Given = Track | SupervisedTrack


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be run; can be pickled where the factory can.

    Attributes:
        factory: makes a fresh tracker.
        sequence: to run it over.
        supervised: when to start it again; None for one pass.
        journal: file that gets each frame as it comes; None for none.
        seed: of Python's and NumPy's global generators, where the task runs in a worker.
    """

    factory: TrackerFactory
    sequence: Sequence
    supervised: SupervisedConfig | None = None
    journal: Path | None = None
    seed: int = 0


def run_task(
    task: Task,
    on_frame: Callable[[int], None] | None = None,
    on_made: Callable[[], None] | None = None,
) -> Given:
    """Run a task to its end; what fails is said in the track's `failure`.

    Args:
        task: what is to be run.
        on_frame: called with the number of frames done, after each.
        on_made: called when the tracker has been made.

    Returns:
        the track, with everything known before a failure.
    """
    with ExitStack() as stack:
        journal = None
        if task.journal is not None:
            task.journal.parent.mkdir(parents=True, exist_ok=True)
            journal = stack.enter_context(task.journal.open("w", encoding="utf-8"))
        log = FrameLog(len(task.sequence), journal, on_frame)
        if not task.sequence.annotated.any():
            return ended(task, log, "no frame is annotated, so there is none to start at", True)

        def factory() -> SequenceTracker:
            try:
                tracker = task.factory()
            except Exception as error:
                raise _NotMade(told(error)) from error
            if on_made is not None:
                on_made()
            return tracker

        try:
            if task.supervised is None:
                return run_one_pass(factory, task.sequence, log=log)
            return run_supervised(factory, task.sequence, task.supervised, log=log)
        except UnreadableFrames as error:
            return ended(task, log, f"frame {log.done}: cannot be read: {error}", True)
        except _NotMade as error:
            return ended(task, log, f"frame {log.done}: the tracker cannot be made: {error}")


def recovered(task: Task, failure: str) -> Given:
    """The track of a task whose process has died, from what its journal holds.

    Args:
        task: what was run.
        failure: what happened, without the frame.
    """
    if task.journal is None:
        log = FrameLog(len(task.sequence))
    else:
        log = FrameLog.read(task.journal, len(task.sequence))
    return ended(task, log, f"frame {log.done}: {failure}")


def ended(task: Task, log: FrameLog, failure: str, unscored: bool = False) -> Given:
    """The track of a log that breaks off."""
    if task.supervised is None:
        return Track.of(log, failure, unscored)
    if not unscored and log.done < len(task.sequence):
        log.add(log.done, Step.FAILED)
    return SupervisedTrack.of(log, failure, unscored)


class _NotMade(Exception):
    """A factory raised."""
