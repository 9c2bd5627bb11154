"""Bodies of requests: JSON is read whole and small; uploads may not stand still."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator

from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

JSON_BYTES = 64 << 10
"""Of a request that is no upload."""

JSON_SECONDS = 20.0
"""In which such a request has to arrive."""

STALLED_SECONDS = 60.0
"""Without a byte of an upload, after which it is given up."""

_STREAMED = re.compile(r"/api/sessions/[^/]+/(video|frames)")
_WITHOUT_BODY = ("GET", "HEAD", "OPTIONS")


class StalledError(ValueError):
    """No more of an upload came."""


class SmallBodies:
    """ASGI middleware: requests other than uploads are read before the application sees them."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if (
            scope["type"] != "http"
            or scope["method"] in _WITHOUT_BODY
            or _STREAMED.fullmatch(scope["path"])
        ):
            await self._app(scope, receive, send)
            return
        try:
            body = await asyncio.wait_for(_read(receive), JSON_SECONDS)
        except ClientDisconnect:
            return
        except TimeoutError:
            told = f"the request did not arrive within {JSON_SECONDS:g} seconds; send it again"
            await _refused(408, told)(scope, receive, send)
            return
        if body is None:
            told = (
                f"the request has more than {JSON_BYTES >> 10} kB; only videos and frames may be "
                "larger (PUT .../video, POST .../frames)"
            )
            await _refused(413, told)(scope, receive, send)
            return
        await self._app(scope, _replayed(body, receive), send)


async def chunks(stream: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """The pieces of an upload.

    Raises:
        StalledError: none came for too long.
    """
    while True:
        try:
            yield await asyncio.wait_for(anext(stream), STALLED_SECONDS)
        except StopAsyncIteration:
            return
        except TimeoutError:
            raise StalledError(
                f"nothing of the upload came for {STALLED_SECONDS:g} seconds; send it again"
            ) from None


async def _read(receive: Receive) -> bytes | None:
    """The body, or None where it is too large."""
    body = bytearray()
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientDisconnect
        body += message.get("body", b"")
        if len(body) > JSON_BYTES:
            return None
        if not message.get("more_body", False):
            return bytes(body)


def _replayed(body: bytes, receive: Receive) -> Receive:
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def receiving() -> Message:
        return waiting.pop() if waiting else await receive()

    return receiving


def _refused(status: int, told: str) -> JSONResponse:
    # The rest of the body is not read: the connection cannot be used again.
    return JSONResponse({"detail": told, "limit": None}, status, {"Connection": "close"})
