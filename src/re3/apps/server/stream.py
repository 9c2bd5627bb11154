"""The WebSocket of a session: it tells what happens, and takes commands and frames of a camera.

To the page: JSON messages, `state`, `frame`, `boxes`, `dropped`, `refused`, `error` and `gone` by
their `type`; pictures come in binary messages as in `re3.apps.server.wire`, and are to be
acknowledged with {"do": "shown"}. From the page: {"do": "play", "speed": 1}, {"do": "pause"},
{"do": "step", "by": 1}, {"do": "seek", "frame": 7}; binary messages are pictures of the camera.
"""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from typing import Any

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from re3.apps.server.limits import OverLimitError
from re3.apps.server.messages import frame_message
from re3.apps.server.session import NotReadyError, Session
from re3.apps.server.viewer import Viewer

BOXES_A_MESSAGE = 500
"""Frames whose boxes go into one message to a page that comes later."""

GONE = 4404
"""Code of a WebSocket closed because there is no such session."""

router = APIRouter()


class Command(BaseModel):
    """What a page may ask for."""

    model_config = ConfigDict(extra="forbid")

    do: str
    speed: float = Field(1.0, ge=0, le=16)
    by: int = Field(1, ge=-1, le=1)
    frame: int = Field(0, ge=0)


@router.websocket("/api/sessions/{session_id}/stream")
async def stream(socket: WebSocket, session_id: str) -> None:
    """See the module."""
    await socket.accept()
    try:
        session: Session = socket.app.state.sessions.get(session_id)
    except KeyError as error:
        await socket.send_json({"type": "gone", "why": "unknown", "detail": error.args[0]})
        await socket.close(GONE)
        return
    viewer = Viewer(socket.send_text, socket.send_bytes)
    _tell_everything(session, viewer)
    session.viewers.add(viewer)
    tasks = [
        asyncio.create_task(work)
        for work in (viewer.send_for_ever(), viewer.gone.wait(), _listen(socket, session, viewer))
    ]
    try:
        await session.catch_up(viewer)
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        session.viewers.discard(viewer)
        for task in tasks:
            task.cancel()
    for task in done:
        task.exception()  # the page went away while something was being sent
    with suppress(RuntimeError, WebSocketDisconnect):  # closed by the other side already
        await socket.close()


def _tell_everything(session: Session, viewer: Viewer) -> None:
    viewer.tell({"type": "state", "session": session.state()})
    if session.tracked is None:
        return
    indices = sorted(session.tracked.tracked)
    for at in range(0, len(indices), BOXES_A_MESSAGE):
        frames = [frame_message(session.tracked, i) for i in indices[at : at + BOXES_A_MESSAGE]]
        viewer.tell({"type": "boxes", "frames": frames})
    viewer.owed = True


async def _listen(socket: WebSocket, session: Session, viewer: Viewer) -> None:
    with suppress(WebSocketDisconnect):
        while True:
            message: dict[str, Any] = dict(await socket.receive())
            if message["type"] == "websocket.disconnect":
                return
            if message.get("bytes") is not None:
                session.offer_picture(message["bytes"], viewer)
                continue
            try:
                await _obey(Command(**json.loads(message["text"])), session, viewer)
            except (ValidationError, json.JSONDecodeError, TypeError) as error:
                viewer.tell({"type": "error", "error": f"not a command: {error}", "limit": None})
            except (ValueError, NotReadyError) as error:
                kind = error.kind if isinstance(error, OverLimitError) else None
                viewer.tell({"type": "error", "error": str(error), "limit": kind})


async def _obey(command: Command, session: Session, viewer: Viewer) -> None:
    match command.do:
        case "shown":
            viewer.acknowledge()
            await session.catch_up(viewer)
        case "play":
            await session.play(command.speed)
        case "pause":
            await session.pause()
        case "step" if command.by > 0:
            if not await session.change(lambda video: video.forward()):
                session.ended = True
                session.tell_state()
        case "step":
            await session.change(lambda video: video.show(max(0, video.position - 1)))
        case "seek":
            await session.seek(command.frame)
        case _:
            raise ValueError(f"unknown command {command.do!r}; see the API's page")
