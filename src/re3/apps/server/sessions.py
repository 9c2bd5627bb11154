"""All sessions of a server: made, found, and removed with their files."""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from re3.apps.server.limits import Limits
from re3.apps.server.session import Session, Source
from re3.engine import Engine

EXPIRY_CHECK_SECONDS = 2.0

LEFT_ALONE_SECONDS = 60.0
"""A session that no page is open on, unused for so long, makes room for a new one."""


class Sessions:
    """The sessions, their files in a private temporary folder.

    Args:
        engine: of the model that tracks.
        limits: of the server.
    """

    def __init__(self, engine: Engine, limits: Limits) -> None:
        self.limits = limits
        self._engine = engine
        self._temporary = tempfile.TemporaryDirectory(prefix="re3-serve-")
        self._sessions: dict[str, Session] = {}

    @property
    def folder(self) -> Path:
        """Of all files, readable by its owner only."""
        return Path(self._temporary.name)

    def __len__(self) -> int:
        return len(self._sessions)

    def __iter__(self) -> Iterator[str]:
        """Their ids."""
        return iter(self._sessions)

    async def make_room(self) -> None:
        """Where there are as many as allowed, end the one that was left alone for longest."""
        if len(self) < self.limits.sessions:
            return
        oldest = time.monotonic() - LEFT_ALONE_SECONDS
        left = [
            each
            for each in self._sessions.values()
            if each.used_at < oldest and not each.viewers and not each.busy
        ]
        if left:
            await self.remove(min(left, key=lambda each: each.used_at).id)

    def create(self, source: Source, title: str) -> Session:
        """A new session.

        Raises:
            OverLimitError: there are as many as allowed.
        """
        self.limits.check_sessions(len(self._sessions))
        session = Session(source, title, self.folder, self._engine, self.limits)
        self._sessions[session.id] = session
        return session

    def get(self, session_id: str) -> Session:
        """Raises KeyError for one that there is not (any more)."""
        if session_id not in self._sessions:
            raise KeyError(
                "there is no such session (any more); sessions end when nobody has used them for "
                f"{self.limits.idle_minutes:g} minutes, when newer ones need their place, and when "
                "the server stops"
            )
        return self._sessions[session_id]

    async def remove(self, session_id: str, why: str = "ended") -> None:
        """End a session and remove its files; raises KeyError as `get` does."""
        session = self.get(session_id)
        del self._sessions[session_id]
        for viewer in session.viewers:
            viewer.tell({"type": "gone", "why": why})
        await session.close()

    async def expire(self) -> None:
        """End the sessions that nobody has used for too long."""
        oldest = time.monotonic() - 60 * self.limits.idle_minutes
        for session in list(self._sessions.values()):
            if session.used_at < oldest and not session.busy:
                with suppress(KeyError):
                    await self.remove(session.id, "expired")

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """While the server runs: ends idle sessions; at the end all of them."""
        watch = asyncio.create_task(self._expire_for_ever())
        try:
            yield
        finally:
            watch.cancel()
            for session_id in list(self._sessions):
                await self.remove(session_id, "stopped")
            self._temporary.cleanup()

    async def _expire_for_ever(self) -> None:
        while True:
            await asyncio.sleep(EXPIRY_CHECK_SECONDS)
            await self.expire()
