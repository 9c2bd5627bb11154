"""Worker processes that run trackers, so that one that hangs or crashes can be done away with.

Each worker runs one task at a time. Frames are read, tracked and timed inside it, and it tells of
its progress through shared memory, which costs the tracker nothing; what it gave comes back once,
at the end. A worker that says nothing for too long is killed, and the next task gets a fresh one.

Workers are spawned, not forked: a copy of a process with running threads (ONNX Runtime, OpenCV)
may hang for reasons that are not the tracker's. A program that calls this from its main module has
to guard that with `if __name__ == "__main__"`, as always with spawned processes.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import random
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from ctypes import c_longlong
from multiprocessing.connection import Connection, wait
from multiprocessing.sharedctypes import RawArray
from typing import Any

import numpy as np

from re3.evaluation.one_pass import told
from re3.evaluation.task import Given, Task, recovered, run_task

_CONTEXT = multiprocessing.get_context("spawn")
_POLL = 0.1
"""Seconds between looks at how far the workers are."""
_START_LIMIT = 120.0
"""Seconds a worker may take to start: the imports of a cold disk."""
_ENDING = 2.0
"""Seconds a process may take to end that has closed its connection."""
_FRAMES, _SIGNS = 0, 1
"""Places in the shared memory: frames done of the task, and a counter of signs of life."""


class WorkerPool:
    """Runs tasks in worker processes; a context manager that ends them.

    Args:
        jobs: how many at a time.
        timeout: seconds a worker may take for a frame, and to make a tracker.

    Raises:
        ValueError: `jobs` is below 1, or `timeout` is not above 0.
    """

    def __init__(self, jobs: int, timeout: float) -> None:
        if jobs < 1:
            raise ValueError(f"jobs is {jobs}; expected 1 or more")
        if not timeout > 0:
            raise ValueError(f"timeout is {timeout} seconds a frame; expected more than 0")
        self._jobs = jobs
        self._timeout = timeout
        self._idle: list[_Worker] = []
        self._busy: dict[int, _Worker] = {}

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in [*self._idle, *self._busy.values()]:
            worker.kill()
        self._idle.clear()
        self._busy.clear()

    def run(
        self,
        tasks: list[Task],
        on_frame: Callable[[int, int], None] | None = None,
    ) -> Iterator[tuple[int, Given]]:
        """Run the tasks, in order as workers get free.

        Args:
            tasks: what is to be run.
            on_frame: called with a task's index and the number of its frames done, ten times a
                second at most.

        Yields:
            index of a task and what it gave, as they end.

        Raises:
            ValueError: a tracker cannot be sent to another process.
        """
        # Before the first runs: one that cannot be sent is a mistake of the caller.
        packed = [_packed(task) for task in tasks]
        waiting = list(range(len(tasks)))[::-1]
        while waiting or self._busy:
            while waiting and len(self._busy) < self._jobs:
                index = waiting.pop()
                worker = self._idle.pop() if self._idle else _Worker()
                worker.give(packed[index])
                self._busy[index] = worker
            wait([worker.connection for worker in self._busy.values()], timeout=_POLL)
            for index, worker in list(self._busy.items()):
                given = self._look(tasks[index], worker)
                if on_frame is not None:
                    on_frame(index, worker.frames)
                if given is None:
                    continue
                del self._busy[index]
                if worker.alive:
                    self._idle.append(worker)
                yield index, given

    def _look(self, task: Task, worker: _Worker) -> Given | None:
        """What the worker has given, or would have if it still could; None while it runs."""
        silent, limit = worker.silent_for(), self._timeout
        try:
            # A worker that has died has its end of the connection closed: that reads as an end.
            if worker.connection.poll():
                return _unpacked(task, worker.connection.recv_bytes())
        except (EOFError, OSError):
            code = worker.exit_code()
            worker.kill()
            return recovered(task, f"the tracker's process died ({_said(code)})")
        if not worker.ready:
            limit = max(limit, _START_LIMIT)
        if silent <= limit:
            return None
        worker.kill()
        return recovered(task, f"no answer within {limit:g} seconds; the tracker was stopped")


class _Worker:
    """A process and the two ways to hear from it."""

    def __init__(self) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        self._shared: Any = RawArray(c_longlong, 2)
        self._process = _CONTEXT.Process(
            target=_serve, args=(theirs, self._shared), daemon=False, name="re3-eval-worker"
        )
        self._process.start()
        theirs.close()
        self._heard = (0, time.monotonic())
        self.alive = True

    @property
    def ready(self) -> bool:
        """It has started."""
        return self._shared[_SIGNS] > 0

    @property
    def frames(self) -> int:
        """Frames done of its task."""
        return self._shared[_FRAMES]

    def give(self, packed: bytes) -> None:
        """Let it run a task."""
        self._shared[_FRAMES] = 0
        self._heard = (self._shared[_SIGNS], time.monotonic())
        # Where it has died, reading from it says so.
        with suppress(OSError):
            self.connection.send_bytes(packed)

    def silent_for(self) -> float:
        """Seconds without a sign of life."""
        signs, now = self._shared[_SIGNS], time.monotonic()
        if signs != self._heard[0]:
            self._heard = (signs, now)
        return now - self._heard[1]

    def exit_code(self) -> int | None:
        """Of a process that has closed its connection; None where it goes on all the same."""
        self._process.join(_ENDING)
        return self._process.exitcode

    def kill(self) -> None:
        """End it at once, with what it has started."""
        self.alive = False
        _kill_group(self._process.pid)
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve(connection: Connection, shared: Any) -> None:
    """What a worker does: task after task, until the connection ends."""
    detach()
    shared[_SIGNS] += 1
    while True:
        try:
            packed = connection.recv_bytes()
        except EOFError:
            return

        def on_frame(done: int) -> None:
            shared[_FRAMES] = done
            shared[_SIGNS] += 1

        def on_made() -> None:
            shared[_SIGNS] += 1

        try:
            task: Task = pickle.loads(packed)
        except Exception as error:  # noqa: BLE001, importing another's module may raise anything
            connection.send_bytes(pickle.dumps(told(error)))
            continue
        random.seed(task.seed)
        # Trackers that draw numbers draw from the old global generator, if from NumPy at all.
        np.random.seed(task.seed)  # noqa: NPY002
        connection.send_bytes(pickle.dumps(run_task(task, on_frame, on_made)))


def detach() -> None:
    """Make this process one that ends with its parent, and neither before nor after."""
    # Ctrl-C is the parent's to handle; it ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "setsid"):
        os.setsid()
    # What a tracker prints must not get between the tables.
    sys.stdout.flush()
    os.dup2(sys.stderr.fileno(), 1)
    parent = multiprocessing.parent_process()
    assert parent is not None, "a worker is started by another process"

    def follow_parent() -> None:
        parent.join()
        if hasattr(os, "killpg"):
            os.killpg(0, signal.SIGKILL)
        os._exit(1)

    threading.Thread(target=follow_parent, daemon=True).start()


def _packed(task: Task) -> bytes:
    try:
        return pickle.dumps(task)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(
            f"the tracker for sequence {task.sequence.name!r} cannot be sent to a worker process "
            f"({told(error)}); expected a factory that can be pickled, such as a class or a "
            "function of a module, or jobs=0, which runs it in this process"
        ) from error


def _unpacked(task: Task, packed: bytes) -> Given:
    given = pickle.loads(packed)
    if isinstance(given, str):
        return recovered(task, f"the tracker cannot be sent to a worker process: {given}")
    return given


def _said(code: int | None) -> str:
    if code is None:
        return "it closed its connection"
    if code < 0:
        return f"signal {-code}, {signal.strsignal(-code)}"
    return f"exit code {code}"


def _kill_group(pid: int | None) -> None:
    """End a worker and the processes it has started, where they have a group of their own."""
    if pid is None or not hasattr(os, "killpg"):
        return
    with suppress(ProcessLookupError, PermissionError):
        # A worker that has not come to make its group yet has started nothing either.
        if os.getpgid(pid) == pid:
            os.killpg(pid, signal.SIGKILL)
