"""`re3 serve`: the page that tracks in the browser."""

from __future__ import annotations

from typing import Annotated

import typer

from re3.apps.console import failed, stderr
from re3.apps.server.limits import Limits
from re3.engine import ENGINES
from re3.models import DEFAULT_MODEL

DEFAULTS = Limits()


def serve(
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets the whole network in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0 takes a free one.", min=0, max=65535)] = 8300,
    model: Annotated[
        str, typer.Option(help="A model's name (see `re3 models`) or file.")
    ] = DEFAULT_MODEL,
    engine: Annotated[str, typer.Option(help=f"One of {', '.join(ENGINES)}.")] = "auto",
    max_upload: Annotated[
        float, typer.Option(help="Size of a video in MB (millions of bytes).", min=0.1)
    ] = DEFAULTS.upload_mb,
    max_duration: Annotated[
        float, typer.Option(help="Length of a video in seconds.", min=0.1)
    ] = DEFAULTS.duration_s,
    max_resolution: Annotated[
        str, typer.Option(help="Largest frame, either way round.", metavar="WIDTHxHEIGHT")
    ] = f"{DEFAULTS.width}x{DEFAULTS.height}",
    max_sessions: Annotated[
        int, typer.Option(help="Sessions kept at once.", min=1)
    ] = DEFAULTS.sessions,
    max_objects: Annotated[
        int, typer.Option(help="Objects of a session.", min=1)
    ] = DEFAULTS.objects,
    idle_timeout: Annotated[
        float,
        typer.Option(help="Minutes after which a session that nobody uses is removed.", min=0.05),
    ] = DEFAULTS.idle_minutes,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(
            help="A name by which the server may be asked, besides localhost and addresses; "
            "repeat for several.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    open_page: Annotated[
        bool, typer.Option("--open", help="Open the page in the browser.")
    ] = False,
) -> None:
    """Serve the page: draw a box in a video or before the webcam, and watch it being tracked.

    Example:

        re3 serve --open
    """
    try:
        from re3.apps.server.application import create_app
        from re3.apps.server.running import Server, open_browser
    except ImportError as error:
        raise failed(
            f"re3 serve needs FastAPI and Uvicorn ({error}): pip install 're3[serve]'"
        ) from error
    try:
        width, height = _parse_resolution(max_resolution)
        limits = Limits(
            max_upload, max_duration, width, height, max_sessions, max_objects, idle_timeout
        )
        server = Server(create_app(model, engine, limits, allow_host or []), host, port)
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    stderr().print(f"re3 listens on {server.url} (Ctrl-C stops it)", markup=False)
    if server.public_url is not None:
        stderr().print(
            f"warning: others reach it at {server.public_url}, by any network of this computer, "
            "without a password and without encryption; --host 127.0.0.1 keeps them out",
            markup=False,
            soft_wrap=True,
        )
    if open_page:
        open_browser(server.url)
    server.run()


def _parse_resolution(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise ValueError(
            f"--max-resolution {text!r} is not WIDTHxHEIGHT in pixels, such as 1920x1080"
        )
    return int(width), int(height)
