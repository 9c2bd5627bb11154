"""The web application: page, REST, WebSocket, and errors that say what to do."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

import re3
from re3.apps.server.bodies import SmallBodies, StalledError
from re3.apps.server.export_routes import router as export_routes
from re3.apps.server.limits import Limits
from re3.apps.server.playing import TrackingFailedError
from re3.apps.server.problems import NotReadyError, problem, status
from re3.apps.server.problems import told as told_error
from re3.apps.server.routes import CLIENT_GONE
from re3.apps.server.routes import router as rest
from re3.apps.server.security import SameSiteOnly
from re3.apps.server.sessions import Sessions
from re3.apps.server.stream import router as streams
from re3.engine import load_engine
from re3.models import DEFAULT_MODEL

PAGE = Path(__file__).parents[1] / "page"

DESCRIPTION = """Track objects in a video: create a session, upload the video, give an object's box
in the first frame, track, get the boxes. examples/client.py does so in 20 lines.

A session's WebSocket, /api/sessions/{session_id}/stream, tells of every frame as it is tracked
and takes frames of a camera; see docs/serve.md."""


def create_app(
    model: str = DEFAULT_MODEL,
    engine: str = "auto",
    limits: Limits | None = None,
    names: Iterable[str] = (),
) -> FastAPI:
    """The application, with the model loaded.

    Args:
        model, engine: as in `re3.MultiTracker`.
        limits: what it allows.
        names: host names by which it may be asked, besides addresses and localhost.

    Raises:
        FileNotFoundError, ImportError, ValueError: the model cannot be loaded.
    """
    sessions = Sessions(load_engine(model, engine), limits or Limits())

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        async with sessions.running():
            yield

    app = FastAPI(
        title="re3",
        version=re3.__version__,
        description=DESCRIPTION,
        lifespan=lifespan,
        # Their pages load scripts from elsewhere; /docs is our own.
        docs_url=None,
        redoc_url=None,
    )
    app.state.sessions, app.state.model = sessions, model
    app.add_middleware(SmallBodies)
    app.add_middleware(SameSiteOnly, names=names)
    app.include_router(rest)
    app.include_router(export_routes)
    app.include_router(streams)
    _add_errors(app)
    _add_pages(app)
    return app


def _add_pages(app: FastAPI) -> None:
    @app.get("/", include_in_schema=False)
    @app.get("/s/{session_id}", include_in_schema=False)
    async def page() -> FileResponse:
        return FileResponse(PAGE / "index.html")

    @app.get("/docs", include_in_schema=False)
    async def docs() -> FileResponse:
        return FileResponse(PAGE / "docs.html")

    app.mount("/page", StaticFiles(directory=PAGE), name="page")


def _add_errors(app: FastAPI) -> None:
    def told(status: int, detail: str, limit: str | None = None) -> Response:
        return JSONResponse({"detail": detail, "limit": limit}, status)

    async def refused(_: Request, error: Exception) -> Response:
        body = problem(error)
        return told(status(error), body["error"], body["limit"])

    for kind in (ValueError, KeyError, NotReadyError, TrackingFailedError, OSError):
        app.add_exception_handler(kind, refused)

    @app.exception_handler(StalledError)
    async def stalled(_: Request, error: StalledError) -> Response:
        return told(408, str(error))

    @app.exception_handler(ClientDisconnect)
    async def gone(_: Request, error: ClientDisconnect) -> Response:
        return Response(status_code=CLIENT_GONE)

    @app.exception_handler(Exception)
    async def unexpected(_: Request, error: Exception) -> Response:
        return told(500, told_error(error))

    @app.exception_handler(RequestValidationError)
    async def invalid(_: Request, error: RequestValidationError) -> Response:
        parts = [
            f"{'.'.join(str(part) for part in each['loc'])}: {each['msg']}"
            for each in error.errors()
        ]
        return told(422, "; ".join(parts))

    @app.exception_handler(HTTPException)
    async def other(_: Request, error: HTTPException) -> Response:
        return told(error.status_code, str(error.detail))
