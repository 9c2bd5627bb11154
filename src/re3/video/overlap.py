"""Reading frames ahead and writing them behind, each in a thread, while others are tracked.

Decoding and encoding release Python's lock, so that with several cores they cost no time of their
own. Few frames wait in between, so that memory stays small.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Generic, Self, TypeVar

Item = TypeVar("Item")

DEPTH = 4
"""Frames that wait at most: 25 MB of 1080p."""

PATIENCE = 0.1
"""Seconds after which a thread that waits for room looks whether it is still wanted."""


class ReadAhead(Generic[Item]):
    """Items of an iterable, fetched by a thread before they are asked for.

    A context manager, to be walked once; when the block ends the thread is done with the iterable,
    which may then be closed. What the iterable raises is raised where its next item would be.

    Args:
        items: walked in the thread.
        depth: items fetched at most before they are asked for.
    """

    def __init__(self, items: Iterable[Item], depth: int = DEPTH) -> None:
        self._items = items
        self._waiting: queue.Queue[tuple[Item] | BaseException | None] = queue.Queue(depth)
        self._unwanted = threading.Event()
        self._thread = threading.Thread(target=self._fetch, name="read ahead", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __iter__(self) -> Iterator[Item]:
        while True:
            got = self._waiting.get()
            if got is None:
                return
            if isinstance(got, BaseException):
                raise got
            yield got[0]

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._unwanted.set()
        self._thread.join()

    def _fetch(self) -> None:
        try:
            for item in self._items:
                if not self._put((item,)):
                    return
        except BaseException as error:  # noqa: BLE001 - raised again where the items are asked for
            self._put(error)
        else:
            self._put(None)

    def _put(self, what: tuple[Item] | BaseException | None) -> bool:
        """Whether it was still wanted."""
        while not self._unwanted.is_set():
            try:
                self._waiting.put(what, timeout=PATIENCE)
            except queue.Full:
                continue
            return True
        return False


class WriteBehind(Generic[Item]):
    """Hands items to a function in a thread, in order, while the caller goes on.

    A context manager: when the block ends, also by an exception, every item has been handed over.
    What the function raises is raised by the next `put` or at the end of the block; items after it
    are dropped.

    Args:
        write: called with each item, in the thread.
        depth: items that wait at most; then `put` waits.
    """

    def __init__(self, write: Callable[[Item], None], depth: int = DEPTH) -> None:
        self._write = write
        self._waiting: queue.Queue[tuple[Item] | None] = queue.Queue(depth)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="write behind", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def put(self, item: Item) -> None:
        """Leave an item to be written.

        Raises:
            Whatever writing an earlier one raised.
        """
        self._complain()
        self._waiting.put((item,))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._waiting.put(None)
        self._thread.join()
        if error is None:
            self._complain()

    def _complain(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _work(self) -> None:
        failed = False
        while (got := self._waiting.get()) is not None:
            if failed:
                continue  # Taken all the same, or `put` would wait for ever.
            try:
                self._write(got[0])
            except BaseException as error:  # noqa: BLE001 - raised again by `put`
                self._error, failed = error, True
