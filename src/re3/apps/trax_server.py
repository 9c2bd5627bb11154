"""`python -m re3.apps.trax_server`: any tracker known by name as a TraX server.

The other end is whatever started it: the VOT toolkit, or `re3.evaluation.trax.TraxTracker`. They
speak through standard input and output, so nothing else may be written there; what goes wrong is
told on standard error.
"""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from re3.apps.console import failed
from re3.apps.options import PeersOption
from re3.evaluation.one_pass import close
from re3.evaluation.peers import SequenceTracker, TrackerFactory, find_tracker, seeded_factory
from re3.evaluation.trax import import_trax
from re3.evaluation.vot_regions import box_of, image_of

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def serve(
    tracker: Annotated[
        str,
        typer.Option("--tracker", "-t", help="A tracker as `re3 eval` takes it.", metavar="NAME"),
    ],
    peers: PeersOption = None,
    directory: Annotated[
        Path | None,
        typer.Option(
            "--directory",
            help="Folder that relative paths start from, where the client starts us elsewhere.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Offer a tracker over TraX, on standard input and output, until the client says quit.

    Example:

        python -m re3.apps.trax_server --tracker re3-lite
    """
    try:
        if directory is not None:
            os.chdir(directory)
        info = find_tracker(tracker, peers)
        if info.factory is None:
            raise ValueError(f"{tracker} cannot be run: {info.about}; expected a tracker")
        answer_requests(seeded_factory(info, 0), info.name, info.about)
    except (ImportError, OSError, RuntimeError, ValueError) as error:
        raise failed(error) from error


def answer_requests(factory: TrackerFactory, name: str, about: str = "") -> None:
    """Answer a TraX client until it quits, a fresh tracker for every start.

    The region is a rectangle, xywh in pixels, 0-based; the tracker's score goes along as the
    property `confidence`. A tracker that raises ends the session, with what it said as reason.

    Args:
        factory: makes the tracker.
        name: what it is called.
        about: what it is, in a line.

    Raises:
        ModuleNotFoundError: the package vot-trax is missing.
        RuntimeError: the client ended the session without saying quit, or broke the protocol.
    """
    trax = import_trax()
    current: SequenceTracker | None = None
    server = trax.Server(
        [trax.Region.RECTANGLE],
        [trax.Image.PATH, trax.Image.MEMORY, trax.Image.BUFFER],
        ["color"],
        tracker_name=name,
        tracker_description=about,
    )
    # The server says goodbye when the block ends, and why if it ended with an exception.
    with server, ExitStack() as started:
        while True:
            try:
                request = server.wait()
            except trax.TraxException as error:
                raise RuntimeError(f"the TraX session broke off: {error}") from error
            if request.type == trax.TraxStatus.QUIT:
                return
            frame = image_of(request.image["color"])
            if request.type == trax.TraxStatus.INITIALIZE:
                box, properties = box_of(request.objects[0][0]), {}
                # Of the last start nothing is left but what it keeps open.
                started.close()
                current = factory()
                started.callback(close, current)
                current.init(frame, box)
            elif current is None:
                raise RuntimeError("the client sent a frame before it started the tracker")
            else:
                given, score = current.update(frame)
                x, y, w, h = (float(value) for value in np.asarray(given))
                box, properties = (x, y, w, h), {"confidence": float(score)}
            server.status([(trax.Rectangle.create(*box), properties)])


def main() -> None:
    """Entry point; a client that went away ends it without a traceback."""
    try:
        app()
    except BrokenPipeError:
        # Python would complain once more when it flushes standard output at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
