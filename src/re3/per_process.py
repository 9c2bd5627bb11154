"""Values that a process must make for itself: their threads do not survive a fork."""

from __future__ import annotations

import ctypes
import os
import weakref
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import cv2

T = TypeVar("T")


class PerProcess(Generic[T]):
    """A value with threads of its own, made anew in a process that was forked off.

    Args:
        make: makes the value.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._made: tuple[int, T] | None = None
        _ALL.add(self)

    def get(self) -> T:
        """The value of this process."""
        process = os.getpid()
        if self._made is None or self._made[0] != process:
            self._made = process, self._make()
        return self._made[1]

    def keep(self) -> None:
        """Never destroy the value: its end would wait for threads that this process lacks."""
        if self._made is not None:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._made[1]))


_ALL: weakref.WeakSet[PerProcess[Any]] = weakref.WeakSet()


def _after_fork() -> None:
    for each in list(_ALL):
        each.keep()
    # OpenCV's threads are gone as well: it works in the caller's from here on.
    cv2.setNumThreads(0)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
