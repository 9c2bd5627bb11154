"""Fixtures of the server's tests."""

import threading
from contextlib import contextmanager

import pytest

from re3.apps.server.application import create_app
from re3.apps.server.limits import Limits
from re3.apps.server.running import Server
from re3.apps.server.samples import find_sample
from re3.video import VideoWriter, open_source

SHORT = 30


@pytest.fixture(scope="session")
def short_clip(tmp_path_factory):
    """The first 30 frames of the sample clip."""
    path = tmp_path_factory.mktemp("clip") / "short.mp4"
    with (
        open_source(find_sample("person.mp4").path) as source,
        VideoWriter(path, source.fps, source.size) as writer,
    ):
        for frame, _ in zip(source, range(SHORT), strict=False):
            writer.write(frame.image)
    return path


@contextmanager
def _running_server(**limits):
    app = create_app(limits=Limits(**{"sessions": 20, **limits}))
    server = Server(app, "127.0.0.1", 0)
    server.app = app
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(timeout=20)
        assert not thread.is_alive()


@pytest.fixture(scope="session")
def running_server():
    """Makes a server on a port of its own, to be used with `with`; its application is `.app`."""
    return _running_server
