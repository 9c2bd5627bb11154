"""What goes forward in a video by itself: playing, and tracking again after a change."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, Protocol

from re3.apps.server.tracked_video import TrackedVideo
from re3.video import SourceError

LATE = 0.5
"""Seconds behind the video's own pace after which the lost time is given up, not made up for."""

TOLD_EVERY = 0.3
"""Seconds between two messages of what was tracked again."""

_log = logging.getLogger(__name__)


class TrackingFailedError(RuntimeError):
    """Tracking stopped by an unexpected error; the session can go on being used."""


class Listener(Protocol):
    """Who is told of what the player does."""

    async def moved(self, fast: bool) -> None:
        """Another frame is shown."""

    async def tracked_again(self, frames: list[int]) -> None:
        """Frames have been tracked again, apart from the one shown."""

    async def stopped(self) -> None:
        """It plays no more."""

    async def failed(self, told: str) -> None:
        """It stopped by an error."""


class Player:
    """Plays, or tracks again in the background; one of them at a time.

    Args:
        run: does work in the session's thread.
        listener: is told of everything.

    Attributes:
        playing: whether it goes forward by itself.
        ended: whether it has come to the video's end by itself.
    """

    def __init__(
        self, run: Callable[[Callable[[], Any]], Awaitable[Any]], listener: Listener
    ) -> None:
        self.playing = False
        self.ended = False
        self._run, self._listener = run, listener
        self._halt = asyncio.Event()
        self._player: asyncio.Task[None] | None = None
        self._catching_up: asyncio.Task[None] | None = None
        self._failure: str | None = None

    def play(self, video: TrackedVideo, speed: float, until: int | None) -> None:
        """Start; to be called when stopped.

        Args:
            video: to go forward in.
            speed: times the video's own; 0 for as fast as possible.
            until: the frame to stop at.
        """
        self.playing, self.ended, self._failure = True, False, None
        self._halt.clear()
        self._player = asyncio.create_task(self._play(video, speed, until))

    def catch_up(self, video: TrackedVideo) -> None:
        """Track again in the background what a change made necessary; to be called when stopped."""
        if not self.playing and video.frames_to_catch_up():
            self._halt.clear()
            self._catching_up = asyncio.create_task(self._catch_up(video))

    async def stop(self) -> None:
        """Stop after the frame that is being tracked; returns at once where nothing goes on."""
        self.playing = False
        self._halt.set()
        tasks = [task for task in (self._player, self._catching_up) if task is not None]
        if tasks:
            await asyncio.wait(tasks)  # whatever came of them
        self._player = self._catching_up = None

    async def finish(self) -> None:
        """Wait until it has stopped playing by itself.

        Raises:
            TrackingFailedError: by an error.
        """
        if self._player is not None:
            await asyncio.wait([self._player])
        if self._failure is not None:
            raise TrackingFailedError(self._failure)

    def cancel(self) -> None:
        """Stop at once, without waiting."""
        self.playing = False
        self._halt.set()
        for task in (self._player, self._catching_up):
            if task is not None:
                task.cancel()

    async def _play(self, video: TrackedVideo, speed: float, until: int | None) -> None:
        loop = asyncio.get_running_loop()
        due, before = loop.time(), video.frame.timestamp
        try:
            while self.playing and (until is None or video.position < until):
                if not await self._run(video.forward):
                    self.ended = True
                    break
                await self._listener.moved(speed == 0)
                if speed > 0:
                    due += (video.frame.timestamp - before) / speed
                    before = video.frame.timestamp
                    if loop.time() - due > LATE:
                        due = loop.time()
                    await self._sleep(due - loop.time())
                else:
                    await asyncio.sleep(0)  # so that others get their turn
        except SourceError as error:
            video.broken = str(error)
        except Exception as error:  # noqa: BLE001, the session has to go on
            await self._fail(video, error)
        self.playing = False
        if not self._halt.is_set():
            self.catch_up(video)
        await self._listener.stopped()

    async def _catch_up(self, video: TrackedVideo) -> None:
        done: list[int] = []
        told = time.monotonic()
        try:
            while not self._halt.is_set():
                index = await self._run(video.catch_up)
                if index is not None:
                    done.append(index)
                if done and (index is None or time.monotonic() - told > TOLD_EVERY):
                    await self._listener.tracked_again(done)
                    done, told = [], time.monotonic()
                if index is None:
                    break
            if done:
                await self._listener.tracked_again(done)
        except SourceError as error:
            video.broken = str(error)
            video.give_up_catching_up()
        except Exception as error:  # noqa: BLE001, the session has to go on
            video.give_up_catching_up()
            await self._fail(video, error)

    async def _fail(self, video: TrackedVideo, error: Exception) -> None:
        self._failure = (
            f"tracking stopped after frame {video.position}: {str(error) or type(error).__name__}; "
            "go on from another frame, or start the server again where it keeps happening"
        )
        _log.error("%s", self._failure, exc_info=not isinstance(error, OSError))
        await self._listener.failed(self._failure)

    async def _sleep(self, seconds: float) -> None:
        """Sleep, but wake up to stop."""
        if seconds <= 0:
            await asyncio.sleep(0)
            return
        with suppress(TimeoutError):
            await asyncio.wait_for(self._halt.wait(), seconds)
