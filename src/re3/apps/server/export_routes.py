"""REST: what was found, as files."""

from __future__ import annotations

import asyncio
import re
import shutil
import tempfile
from functools import partial
from pathlib import Path
from urllib.parse import quote

from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from re3.apps.server.exports import KINDS, Tracks, bgr, write_boxes, write_video
from re3.apps.server.limits import Limits
from re3.apps.server.problems import NotReadyError
from re3.apps.server.routes import CLIENT_GONE, PROBLEMS, All, One
from re3.apps.server.session import Session

router = APIRouter(prefix="/api", responses=PROBLEMS)


@router.get("/sessions/{session_id}/export/{kind}", tags=["results"], response_class=FileResponse)
async def export(session: One, kind: str, every: All, request: Request) -> Response:
    """Download the results: csv, json, otb, mot, coco or mp4; a ZIP of several files at need.

    One at a time is written in a session; it is given up when the connection is closed. Where the
    clip is not tracked to its end, the file's name ends in `-incomplete`, and the header
    `Re3-Untracked` says what is missing.
    """
    session.use()
    if kind not in KINDS:
        raise KeyError(f"there is no export {kind!r}; expected one of {', '.join(KINDS)}")
    writing = session.start(_export(session, kind, every.limits))
    gone = asyncio.create_task(_gone(request))
    try:
        await asyncio.wait([writing, gone], return_when=asyncio.FIRST_COMPLETED)
    finally:
        gone.cancel()
        if not writing.done():
            writing.cancel()
    if not writing.done():
        await asyncio.wait([writing])
        return Response(status_code=CLIENT_GONE)
    if writing.cancelled():
        raise NotReadyError("the session has been ended while the file was written")
    path, untracked = writing.result()
    media_type = "application/zip" if path.suffix == ".zip" else KINDS[kind].media_type
    return FileResponse(
        path,
        media_type=media_type,
        filename=path.name,
        headers={"Re3-Untracked": quote("; ".join(untracked), safe=" ,;")} if untracked else None,
        background=BackgroundTask(_remove, path.parent),
    )


async def _export(session: Session, kind: str, limits: Limits) -> tuple[Path, list[str]]:
    """The file in a folder of its own, and what is not tracked in it."""
    async with session.exporting:
        tracks, untracked = await session.run(partial(_tracks, session))
        source, stem = session.path, _stem(session.title) + ("-incomplete" if untracked else "")
        assert source is not None
        folder = Path(tempfile.mkdtemp(dir=session.folder))
        try:
            if kind == "mp4":
                session.tell_progress(kind, 0.0)
                progress = partial(session.tell_progress, kind)
                path = await write_video(tracks, source, folder, stem, limits, progress)
            else:
                path = await asyncio.to_thread(write_boxes, tracks, KINDS[kind], folder, stem)
        except BaseException:
            _remove(folder)
            raise
        finally:
            if kind == "mp4":
                session.tell_progress(kind, None)
    return path, untracked


async def _gone(request: Request) -> None:
    """Wait until the client has closed the connection."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


def _tracks(session: Session) -> tuple[Tracks, list[str]]:
    """What was found, and what is not tracked."""
    video = session.video
    height, width = video.frame.image.shape[:2]
    frames = [(i, video.timestamp(i), video.results_at(i)) for i in video.tracked_frames()]
    colours = {each.id: bgr(each.colour) for each in video.objects.values()}
    return Tracks(frames, (width, height), session.fps, colours), video.untracked()


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)


def _stem(title: str) -> str:
    """A name for files to download: no folder, and nothing that a system forbids."""
    stem = re.sub(r"\.[A-Za-z0-9]{1,5}$", "", title)
    return re.sub(r"[^\w.-]+", "_", stem).strip("._")[:80] or "video"
