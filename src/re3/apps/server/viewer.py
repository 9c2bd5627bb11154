"""One page that looks at a session, over its WebSocket: never more than two pictures in flight."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable

from re3.apps.server.wire import Head, packed

PICTURES_IN_FLIGHT = 2
QUEUE = 2000
"""Messages that may wait for a page; one that takes none for so long is let go."""


class Viewer:
    """Sends to one page without ever waiting for it.

    Boxes of every frame are sent. A picture is left out while two of them have not been
    acknowledged; the page is then owed the latest one.

    Args:
        send_text, send_bytes: of the WebSocket.

    Attributes:
        owed: whether a picture was left out since the last one sent.
        frames_received: pictures of its camera that came from this page.
        gone: set when it takes nothing any more.
    """

    def __init__(
        self,
        send_text: Callable[[str], Awaitable[None]],
        send_bytes: Callable[[bytes], Awaitable[None]],
    ) -> None:
        self.owed = False
        self.frames_received = 0
        self.gone = asyncio.Event()
        self._send_text, self._send_bytes = send_text, send_bytes
        self._queue: asyncio.Queue[str | bytes] = asyncio.Queue(QUEUE)
        self._in_flight = 0

    @property
    def ready(self) -> bool:
        """Whether it takes another picture now."""
        return self._in_flight < PICTURES_IN_FLIGHT

    def tell(self, head: Head, picture: bytes | None = None) -> None:
        """Send a message, with a picture or without."""
        if picture is not None:
            self._in_flight += 1
            self.owed = False
        try:
            self._queue.put_nowait(packed(head, picture) if picture else json.dumps(head))
        except asyncio.QueueFull:
            self.gone.set()

    def acknowledge(self) -> None:
        """The page has shown a picture."""
        self._in_flight = max(0, self._in_flight - 1)

    async def send_for_ever(self) -> None:
        """Send what there is to send, until it is cancelled or the page is gone."""
        while True:
            message = await self._queue.get()
            if isinstance(message, bytes):
                await self._send_bytes(message)
            else:
                await self._send_text(message)
