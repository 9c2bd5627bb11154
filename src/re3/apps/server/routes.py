"""REST: sessions, their video, objects, and what was found."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request, Response
from fastapi import Path as PathParameter

import re3
from re3.apps.server import schemas
from re3.apps.server.bodies import chunks
from re3.apps.server.exports import KINDS
from re3.apps.server.limits import Limits
from re3.apps.server.messages import frame_message, jpeg
from re3.apps.server.names import cleaned_title
from re3.apps.server.problems import NotReadyError
from re3.apps.server.samples import find_sample, samples
from re3.apps.server.session import Session
from re3.apps.server.sessions import Sessions

PROBLEMS: dict[int | str, dict[str, Any]] = {
    status: {"model": schemas.Problem, "description": told}
    for status, told in {
        403: "From a page of another site.",
        404: "No such session, object, sample or kind.",
        408: "The request or the upload stood still.",
        409: "Not now: no video yet, too many objects, nothing to undo.",
        413: "Over the limit of size, duration or resolution.",
        422: "Not usable: the video, the box, the name.",
        429: "Too many sessions.",
        500: "An error inside re3; the session goes on.",
        507: "The server's disk is full.",
    }.items()
}

CLIENT_GONE = 499
"""Status where nobody is there to be answered any more; nginx's number."""

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
    session = every.create(new.source, sample.title if sample else cleaned_title(new.name))
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
        await _remove_refused(every, session)
        raise
    await _open_or_remove(every, session, path)
    return _told(session)


@router.post("/sessions/{session_id}/frames", tags=["camera"], openapi_extra=PICTURE_BODY)
async def send_frame(session: One, request: Request, every: All) -> schemas.FoundFrame:
    """Send the next frame of a camera, a JPEG, PNG or WebP picture; what was found in it."""
    data = bytearray()
    async for chunk in chunks(request.stream()):
        data += chunk
        every.limits.check_picture(len(data))
    await session.take_picture(bytes(data))
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
        name, colour = changed.name, changed.colour
        await session.run(lambda: session.video.change(object_id, name, colour))
        session.tell_state()
    if changed.box_xywh is not None:
        box = changed.box_xywh
        await session.change(lambda video: video.correct(object_id, box))
    return _object(session, object_id)


@router.post("/sessions/{session_id}/objects/{object_id}/end", tags=["objects"])
async def end_object(object_id: int, session: One) -> schemas.SessionState:
    """Do not follow an object from the frame shown on, until the next box drawn for it."""
    _object(session, object_id)
    await session.change(lambda video: video.end(object_id))
    return _told(session)


@router.delete("/sessions/{session_id}/objects/{object_id}", status_code=204, tags=["objects"])
async def remove_object(object_id: int, session: One) -> None:
    """Forget an object and all its boxes."""
    _object(session, object_id)
    await session.change(lambda video: video.remove(object_id))


@router.post("/sessions/{session_id}/undo", tags=["objects"])
async def undo(session: One) -> schemas.SessionState:
    """Take the latest change of the objects back, and go to its frame."""
    await session.undo()
    return _told(session)


@router.post("/sessions/{session_id}/redo", tags=["objects"])
async def redo(session: One) -> schemas.SessionState:
    """Make the change again that was taken back last, and go to its frame."""
    await session.undo(redo=True)
    return _told(session)


@router.post("/sessions/{session_id}/seek", tags=["tracking"])
async def seek(to: schemas.Seek, session: One) -> schemas.SessionState:
    """Go to a frame, and wait until it is reached."""
    if to.track:
        await session.seek(to.frame)
        await session.finish_playing()
    else:
        await session.look(to.frame)
    return _told(session)


@router.post("/sessions/{session_id}/track", tags=["tracking"])
async def track(how: schemas.Track, session: One) -> schemas.SessionState:
    """Track what is not tracked yet, as fast as possible, and wait until it is done."""
    await session.track(how.until)
    await session.finish_playing()
    return _told(session)


@router.post("/sessions/{session_id}/pause", tags=["tracking"])
async def pause(session: One) -> schemas.SessionState:
    """Stop where it is."""
    await session.pause()
    return _told(session)


@router.get("/sessions/{session_id}/boxes", tags=["results"])
async def get_boxes(session: One, first: int = 0) -> list[schemas.FoundFrame]:
    """What was found in all frames that have been tracked, from frame `first` on."""
    session.use()
    video = session.video
    told = await session.run(
        lambda: [frame_message(video, i) for i in video.known_frames() if i >= first]
    )
    return [schemas.FoundFrame.model_validate(each) for each in told]


@router.get(
    "/sessions/{session_id}/frame.jpg",
    tags=["results"],
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}},
)
async def get_picture(session: One, whole: bool = False) -> Response:
    """The frame shown, as a picture of 1280 pixels at most; `whole`: as large as in the video."""
    frame = session.video.frame
    picture = await session.run(partial(jpeg, frame, whole))
    return Response(picture, media_type="image/jpeg", headers={"Re3-Frame": str(frame.index)})


@router.post("/sessions/{session_id}/done", status_code=204, tags=["sessions"])
async def done(session: One) -> None:
    """Hand the drawn boxes to `re3 track --select`, which waits for them."""
    if session.source != "select":
        raise NotReadyError("nobody waits for the boxes of this session; download them")
    if not session.video.objects:
        raise NotReadyError("no box is drawn yet; draw one first")
    session.chosen.set()


async def _save(stream: AsyncIterator[bytes], path: Path, limits: Limits, session: Session) -> None:
    size = 0
    with path.open("wb") as file:
        async for chunk in chunks(stream):
            if session.closed:
                raise NotReadyError("the session has been ended during the upload")
            size += len(chunk)
            limits.check_upload(size)
            file.write(chunk)
            session.use()


async def _open_or_remove(every: Sessions, session: Session, path: Path) -> None:
    try:
        await session.open(path)
    except BaseException:
        await _remove_refused(every, session)
        raise


async def _remove_refused(every: Sessions, session: Session) -> None:
    with suppress(KeyError):  # ended meanwhile
        await every.remove(session.id, "refused")


def _told(session: Session) -> schemas.SessionState:
    return schemas.SessionState.model_validate(session.state())


def _object(session: Session, object_id: int) -> schemas.ObjectState:
    for each in _told(session).objects:
        if each.id == object_id:
            return each
    raise KeyError(
        f"there is no object {object_id}; there are {sorted(session.video.objects) or 'none'}"
    )
