"""The WebSocket of a session: it tells what happens, and takes commands and frames of a camera.

To the page: JSON messages, `state`, `frame`, `boxes`, `export`, `dropped`, `refused`, `error` and
`gone` by their `type`; pictures come in binary messages as in `re3.apps.server.wire`, and are to be
acknowledged with {"do": "shown"}. From the page: {"do": "play", "speed": 1}, {"do": "pause"},
{"do": "step", "by": 1}, {"do": "seek", "frame": 7} (tracking on the way),
{"do": "look", "frame": 7} (tracking nothing), {"do": "track"} (all that is not tracked yet),
{"do": "undo"}, {"do": "redo"}; binary messages are pictures of the camera.
"""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from typing import Any

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from re3.apps.server.messages import boxes_messages
from re3.apps.server.problems import problem
from re3.apps.server.schemas import SLOWEST
from re3.apps.server.session import Session
from re3.apps.server.viewer import Viewer

LONGEST_COMMAND = 4096
"""Characters."""

GONE = 4404
"""Code of a WebSocket closed because there is no such session."""

router = APIRouter()


class Command(BaseModel):
    """What a page may ask for."""

    model_config = ConfigDict(extra="forbid")

    do: str
    speed: float = Field(1.0, le=16)
    by: int = Field(1, ge=-1, le=1)
    frame: int = Field(0, ge=0)

    @field_validator("speed")
    @classmethod
    def _is_fast_enough(cls, speed: float) -> float:
        if not (speed == 0 or speed >= SLOWEST):
            raise ValueError(f"expected 0 (as fast as possible) or {SLOWEST} and more")
        return speed


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
    for message in boxes_messages(session.tracked, session.tracked.known_frames()):
        viewer.tell(message)
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
                await _obey(_parsed(message["text"]), session, viewer)
            except Exception as error:  # noqa: BLE001, every command is answered
                viewer.tell({"type": "error", **problem(error)})


def _parsed(text: str) -> Command:
    if len(text) > LONGEST_COMMAND:
        raise ValueError(
            f"the command has {len(text)} characters; expected {LONGEST_COMMAND} at most"
        )
    try:
        return Command(**json.loads(text))
    except (ValidationError, json.JSONDecodeError, TypeError, RecursionError) as error:
        raise ValueError(f"not a command: {error}") from error


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
                session.player.ended = True
                session.tell_state()
        case "step":
            await session.change(lambda video: video.show(max(0, video.position - 1)))
        case "seek":
            await session.seek(command.frame)
        case "look":
            await session.look(command.frame)
        case "track":
            await session.track()
        case "undo" | "redo":
            await session.undo(redo=command.do == "redo")
        case _:
            raise ValueError(f"unknown command {command.do!r}; see the API's page")
