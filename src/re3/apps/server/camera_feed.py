"""Pictures of a camera on their way into a session: of those that wait, only the newest is kept."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple

from re3.apps.server.problems import problem
from re3.apps.server.viewer import Viewer


class _Picture(NamedTuple):
    data: bytes
    at: float  # time.monotonic() of its arrival
    viewer: Viewer | None
    number: int


class CameraFeed:
    """Takes pictures one after the other.

    Args:
        take: tracks into a picture that arrived at a time, and shows it to all pages but the one
            that sent it, which has the picture and is sent the number.
    """

    def __init__(self, take: Callable[[bytes, float, Viewer | None, int], Awaitable[None]]) -> None:
        self._take = take
        self._waiting: _Picture | None = None
        self._task: asyncio.Task[None] | None = None

    def offer(self, data: bytes, viewer: Viewer | None) -> int:
        """Take a picture, in place of one that still waits.

        Returns:
            its number, counted by viewer.
        """
        number = viewer.frames_received if viewer is not None else 0
        if viewer is not None:
            viewer.frames_received += 1
        passed_over, self._waiting = (
            self._waiting,
            _Picture(data, time.monotonic(), viewer, number),
        )
        if passed_over is not None and passed_over.viewer is not None:
            passed_over.viewer.tell({"type": "dropped", "number": passed_over.number})
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._take_all())
        return number

    def cancel(self) -> None:
        """Take no more."""
        self._waiting = None
        if self._task is not None:
            self._task.cancel()

    async def _take_all(self) -> None:
        while self._waiting is not None:
            picture, self._waiting = self._waiting, None
            try:
                await self._take(*picture)
            except Exception as error:  # noqa: BLE001, the next picture may be better
                if picture.viewer is not None:
                    refused = {"type": "refused", "number": picture.number, **problem(error)}
                    picture.viewer.tell(refused)
