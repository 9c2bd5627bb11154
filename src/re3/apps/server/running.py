"""Uvicorn on a socket that is bound before anything is promised, and the browser before it."""

from __future__ import annotations

import os
import socket
import sys
import webbrowser

import uvicorn
from fastapi import FastAPI

BACKLOG = 128
CLOSING_SECONDS = 3
"""That open connections have when the server stops."""


class Server:
    """One process that serves the application.

    Args:
        app: to serve.
        host, port: to listen on; port 0 takes a free one.

    Attributes:
        url: of the page.

    Raises:
        OSError: the address cannot be listened on.
    """

    def __init__(self, app: FastAPI, host: str, port: int) -> None:
        self._app = app
        self._socket = _bound(host, port)
        actual = self._socket.getsockname()[1]
        shown = "127.0.0.1" if host in ("0.0.0.0", "::", "") else host
        self.url = f"http://{f'[{shown}]' if ':' in shown else shown}:{actual}/"
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
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
