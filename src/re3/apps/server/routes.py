"""REST: sessions, their video, objects, and what was found."""

from __future__ import annotations

import asyncio
import re
import shutil
import tempfile
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request, Response
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

import re3
from re3.apps.server import schemas
from re3.apps.server.exports import KINDS, Tracks, bgr, write_boxes, write_video
from re3.apps.server.limits import Limits
from re3.apps.server.messages import frame_message, jpeg
from re3.apps.server.samples import find_sample, samples
from re3.apps.server.session import NotReadyError, Session
from re3.apps.server.sessions import Sessions

PROBLEMS: dict[int | str, dict[str, Any]] = {
    status: {"model": schemas.Problem, "description": told}
    for status, told in {
        403: "From a page of another site.",
        404: "No such session, object, sample or kind.",
        409: "Not now: no video yet, or too many objects.",
        413: "Over the limit of size, duration or resolution.",
        422: "Not usable: the video, the box, the name.",
        429: "Too many sessions.",
    }.items()
}

router = APIRouter(prefix="/api", responses=PROBLEMS)


def _sessions(request: Request) -> Sessions:
    found: Sessions = request.app.state.sessions
    return found


def _session(
    request: Request, session_id: Annotated[str, PathParameter(description="as given by create")]
) -> Session:
    return _sessions(request).get(session_id)


All = Annotated[Sessions, Depends(_sessions)]
One = Annotated[Session, Depends(_session)]
PICTURE_BODY = {
    "requestBody": {
        "required": True,
        "content": {"image/jpeg": {"schema": {"type": "string", "format": "binary"}}},
    }
}
VIDEO_BODY = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


@router.get("/about", tags=["server"])
async def about(request: Request, every: All) -> schemas.About:
    """What the server is, allows and offers."""
    return schemas.About(
        version=re3.__version__,
        model=request.app.state.model,
        limits={name: float(value) for name, value in vars(every.limits).items()},
        samples=[
            schemas.SampleClip(name=each.name, title=each.title, credit=each.credit)
            for each in samples()
        ],
        exports=[schemas.ExportKind(kind=kind, title=about.title) for kind, about in KINDS.items()],
    )


@router.post("/sessions", status_code=201, tags=["sessions"])
async def create_session(new: schemas.NewSession, every: All) -> schemas.SessionState:
    """Create a session; one of a sample clip is ready at once."""
    sample = find_sample(new.name) if new.source == "sample" else None
    await every.make_room()
    session = every.create(new.source, sample.title if sample else _title(new.name))
    if sample is not None:
        await _open_or_remove(every, session, sample.path)
    return _told(session)


@router.get("/sessions/{session_id}", tags=["sessions"])
async def get_session(session: One) -> schemas.SessionState:
    """How things are."""
    session.use()
    return _told(session)


@router.delete("/sessions/{session_id}", status_code=204, tags=["sessions"])
async def end_session(session: One, every: All) -> None:
    """End the session and remove its files."""
    await every.remove(session.id)


@router.put("/sessions/{session_id}/video", tags=["sessions"], openapi_extra=VIDEO_BODY)
async def upload_video(session: One, every: All, request: Request) -> schemas.SessionState:
    """Upload the video, as the body of the request; a session whose video is refused is removed."""
    if session.source != "upload" or session.path is not None or session.tracked is not None:
        raise NotReadyError("the session has a video already; create another, of source 'upload'")
    path = session.path = session.folder / "video"
    try:
        every.limits.check_upload(int(request.headers.get("content-length", "0")))
        await _save(request.stream(), path, every.limits, session)
    except BaseException:
        await every.remove(session.id, "refused")
        raise
    await _open_or_remove(every, session, path)
    return _told(session)


@router.post("/sessions/{session_id}/frames", tags=["camera"], openapi_extra=PICTURE_BODY)
async def send_frame(session: One, request: Request, every: All) -> schemas.FoundFrame:
    """Send the next frame of a camera, a JPEG, PNG or WebP picture; what was found in it."""
    chunks = bytearray()
    async for chunk in request.stream():
        chunks += chunk
        every.limits.check_upload(len(chunks))
    first = session.tracked is None
    await session.take_picture(bytes(chunks))
    if first:
        session.tell_state()
    await session.show()
    return schemas.FoundFrame.model_validate(frame_message(session.video, session.video.position))


@router.post("/sessions/{session_id}/objects", status_code=201, tags=["objects"])
async def add_object(new: schemas.NewObject, session: One) -> schemas.ObjectState:
    """Follow another object from the frame shown on."""
    added = await session.change(lambda video: video.add(new.box_xywh, new.name, new.colour))
    return _object(session, added.id)


@router.patch("/sessions/{session_id}/objects/{object_id}", tags=["objects"])
async def change_object(
    object_id: int, changed: schemas.ChangedObject, session: One
) -> schemas.ObjectState:
    """Call or colour an object otherwise, or correct its box in the frame shown."""
    _object(session, object_id)
    if changed.name is not None or changed.colour is not None:
        session.video.change(object_id, changed.name, changed.colour)
        session.tell_state()
    if changed.box_xywh is not None:
        box = changed.box_xywh
        await session.change(lambda video: video.correct(object_id, box))
    return _object(session, object_id)


@router.post("/sessions/{session_id}/objects/{object_id}/end", tags=["objects"])
async def end_object(object_id: int, session: One) -> schemas.SessionState:
    """Follow an object no more from the frame shown on; its boxes before stay."""
    _object(session, object_id)
    await session.change(lambda video: video.end(object_id))
    return _told(session)


@router.delete("/sessions/{session_id}/objects/{object_id}", status_code=204, tags=["objects"])
async def remove_object(object_id: int, session: One) -> None:
    """Forget an object and all its boxes."""
    _object(session, object_id)
    await session.change(lambda video: video.remove(object_id))


@router.post("/sessions/{session_id}/seek", tags=["tracking"])
async def seek(to: schemas.Seek, session: One) -> schemas.SessionState:
    """Go to a frame, and wait until it is reached."""
    await session.seek(to.frame)
    await session.finish_playing()
    return _told(session)


@router.post("/sessions/{session_id}/track", tags=["tracking"])
async def track(how: schemas.Track, session: One) -> schemas.SessionState:
    """Track as fast as possible, and wait until it is done."""
    await session.play(0, how.until)
    await session.finish_playing()
    return _told(session)


@router.post("/sessions/{session_id}/pause", tags=["tracking"])
async def pause(session: One) -> schemas.SessionState:
    """Stop where it is."""
    await session.pause()
    return _told(session)


@router.get("/sessions/{session_id}/boxes", tags=["results"])
async def get_boxes(session: One, first: int = 0) -> list[schemas.FoundFrame]:
    """What was found in all frames that are up to date, from frame `first` on."""
    session.use()
    told = await session.run(
        lambda: [
            frame_message(session.video, i) for i in sorted(session.video.tracked) if i >= first
        ]
    )
    return [schemas.FoundFrame.model_validate(each) for each in told]


@router.get(
    "/sessions/{session_id}/frame.jpg",
    tags=["results"],
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}},
)
async def get_picture(session: One) -> Response:
    """The frame shown, as a picture."""
    frame = session.video.frame
    return Response(await session.run(partial(jpeg, frame)), media_type="image/jpeg")


@router.get("/sessions/{session_id}/export/{kind}", tags=["results"], response_class=FileResponse)
async def export(session: One, kind: str, every: All) -> FileResponse:
    """Download the results: csv, json, otb, mot, coco or mp4; a ZIP of several files at need."""
    session.use()
    if kind not in KINDS:
        raise KeyError(f"there is no export {kind!r}; expected one of {', '.join(KINDS)}")
    tracks, source = await session.run(partial(_tracks, session)), session.path
    assert source is not None
    folder = Path(tempfile.mkdtemp(dir=session.folder))
    stem = _stem(session.title)
    if kind == "mp4":
        work = partial(write_video, tracks, source, folder, stem, every.limits)
    else:
        work = partial(write_boxes, tracks, KINDS[kind], folder, stem)
    try:
        path = await asyncio.to_thread(work)
    except BaseException:
        _remove(folder)
        raise
    media_type = "application/zip" if path.suffix == ".zip" else KINDS[kind].media_type
    return FileResponse(
        path,
        media_type=media_type,
        filename=path.name,
        background=BackgroundTask(_remove, folder),
    )


@router.post("/sessions/{session_id}/done", status_code=204, tags=["sessions"])
async def done(session: One) -> None:
    """Hand the drawn boxes to `re3 track --select`, which waits for them."""
    if session.source != "select":
        raise NotReadyError("nobody waits for the boxes of this session; download them")
    if not session.video.objects:
        raise NotReadyError("no box is drawn yet; draw one first")
    session.chosen.set()


async def _save(chunks: AsyncIterator[bytes], path: Path, limits: Limits, session: Session) -> None:
    size = 0
    with path.open("wb") as file:
        async for chunk in chunks:
            size += len(chunk)
            limits.check_upload(size)
            file.write(chunk)
            session.use()


async def _open_or_remove(every: Sessions, session: Session, path: Path) -> None:
    try:
        await session.open(path)
    except BaseException:
        await every.remove(session.id, "refused")
        raise


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)


def _told(session: Session) -> schemas.SessionState:
    return schemas.SessionState.model_validate(session.state())


def _object(session: Session, object_id: int) -> schemas.ObjectState:
    for each in _told(session).objects:
        if each.id == object_id:
            return each
    raise KeyError(
        f"there is no object {object_id}; there are {sorted(session.video.objects) or 'none'}"
    )


def _tracks(session: Session) -> Tracks:
    video = session.video
    height, width = video.frame.image.shape[:2]
    frames = [(i, video.tracked[i].timestamp, video.results_at(i)) for i in sorted(video.tracked)]
    colours = {each.id: bgr(each.colour) for each in video.objects.values()}
    return Tracks(frames, (width, height), session.fps, colours)


def _title(name: str) -> str:
    """A file's name as it may be shown: without folders and control characters."""
    last = re.split(r"[/\\]", name)[-1]
    return "".join(c for c in last if c.isprintable()).strip() or "video"


def _stem(title: str) -> str:
    """A name for files to download: no folder, and nothing that a system forbids."""
    stem = re.sub(r"\.[A-Za-z0-9]{1,5}$", "", title)
    return re.sub(r"[^\w.-]+", "_", stem).strip("._")[:80] or "video"
