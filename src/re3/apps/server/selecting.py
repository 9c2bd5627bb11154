"""Boxes drawn by hand for `re3 track --select`: a page on one frame, until they come back."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.apps.server.application import create_app
from re3.apps.server.limits import Limits
from re3.apps.server.running import Server
from re3.apps.tracking import Box

LIMITS = Limits(width=1 << 15, height=1 << 15, objects=100, idle_minutes=24 * 60)
"""One's own frame may be as large as it is."""


class NothingSelectedError(ValueError):
    """The page was stopped before boxes were handed over."""


def select_objects(
    image: NDArray[np.uint8], title: str, announce: Callable[[str], None], port: int = 0
) -> dict[str, Box]:
    """Let boxes be drawn in a frame.

    Args:
        image: uint8 `[H, W, 3]` BGR.
        title: of the source, for people.
        announce: is told the page's address once it answers.
        port: to listen on, on 127.0.0.1; 0 takes a free one.

    Returns:
        name -> x, y, width, height in pixels.

    Raises:
        NothingSelectedError: the server was stopped first.
        OSError: the port cannot be listened on.
    """
    return asyncio.run(_select(image, title, announce, port))


async def _select(
    image: NDArray[np.uint8], title: str, announce: Callable[[str], None], port: int
) -> dict[str, Box]:
    app = create_app(limits=LIMITS)
    server = Server(app, "127.0.0.1", port)
    session = app.state.sessions.create("select", title)
    serving = asyncio.create_task(server.serve())
    path = session.folder / "video"
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    await session.open(path)
    announce(f"{server.url}s/{session.id}")
    chosen = asyncio.create_task(session.chosen.wait())
    await asyncio.wait([serving, chosen], return_when=asyncio.FIRST_COMPLETED)
    objects = {
        each.name: each.given[0] for each in session.video.objects.values() if 0 in each.given
    }
    handed_over = session.chosen.is_set()
    chosen.cancel()
    server.stop()
    await serving
    if not handed_over:
        raise NothingSelectedError("stopped before boxes were handed over; nothing is tracked")
    return objects
