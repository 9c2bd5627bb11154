"""Fixtures of the server's tests."""

import pytest

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
