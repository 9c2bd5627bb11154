"""Uvicorn on a socket that is bound before anything is promised, and the browser before it."""

from __future__ import annotations

import asyncio
import ipaddress
import os
import socket
import sys
import webbrowser
from typing import TYPE_CHECKING, Any

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.auto import AutoHTTPProtocol

if TYPE_CHECKING:
    from uvicorn.protocols.http.h11_impl import H11Protocol as HttpProtocol
else:
    HttpProtocol = AutoHTTPProtocol

BACKLOG = 128

IDLE_SECONDS = 15.0
"""That a connection has for a whole head of a request; uvicorn itself waits for ever."""
CLOSING_SECONDS = 3
"""That open connections have when the server stops."""


class ImpatientProtocol(HttpProtocol):
    """Uvicorn's protocol that closes connections on which no request comes."""

    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """See asyncio.Protocol."""
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        """See asyncio.Protocol."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """See asyncio.Protocol."""
        self._cancel()
        super().connection_lost(exc)

    def _watch(self) -> None:
        """Start the clock where a request is waited for, stop it where one is answered."""
        # A WebSocket takes the connection over.
        own = self.transport.get_protocol() in (self, None)
        if not own or (self.cycle is not None and not self.cycle.response_complete):
            self._cancel()
        elif self._timer is None:
            self._timer = self.loop.call_later(IDLE_SECONDS, self.transport.close)

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class Server:
    """One process that serves the application.

    Args:
        app: to serve.
        host, port: to listen on; port 0 takes a free one.

    Attributes:
        url: of the page, on this computer.
        public_url: of the page for other computers; None where they cannot reach it.

    Raises:
        OSError: the address cannot be listened on.
    """

    def __init__(self, app: FastAPI, host: str, port: int) -> None:
        self._app = app
        self._socket = _bound(host, port)
        address, actual = self._socket.getsockname()[:2]
        everywhere = ipaddress.ip_address(address).is_unspecified
        self.url = _url("127.0.0.1" if everywhere else host, actual)
        self.public_url: str | None = None
        if everywhere:
            self.public_url = _url(_own_address(), actual)
        elif not ipaddress.ip_address(address).is_loopback:
            self.public_url = self.url
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                http=ImpatientProtocol,
                log_level="warning",
                access_log=False,
                server_header=False,
                timeout_graceful_shutdown=CLOSING_SECONDS,
                # A frame of a camera is one message.
                ws_max_size=32 << 20,
                ws_per_message_deflate=False,
            )
        )

    def run(self) -> None:
        """Serve until Ctrl-C, SIGTERM or `stop`."""
        self._server.run(sockets=[self._socket])

    async def serve(self) -> None:
        """The same inside a running event loop."""
        await self._server.serve(sockets=[self._socket])

    def stop(self) -> None:
        """End `run` or `serve`, from any thread."""
        self._server.should_exit = True


def open_browser(url: str) -> bool:
    """Open the page; not in a browser within the terminal, which could not draw."""
    on_screen = sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    )
    return on_screen and webbrowser.open(url)


def _url(host: str, port: int) -> str:
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/"


def _own_address() -> str:
    """This computer's address as others in its network see it; its name where it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect(("192.0.2.1", 9))  # sends nothing, but chooses the network
        except OSError:
            return socket.gethostname()
        return str(asking.getsockname()[0])


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise OSError(
            f"cannot listen on {host}, port {port}: {error.strerror or error}; is re3 serve "
            "running already? Take another one with --port (0 takes a free one)"
        ) from error
    listening.listen(BACKLOG)
    return listening
