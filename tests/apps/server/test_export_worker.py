"""The annotated video of the page keeps the times of its frames and the shape of its pixels."""

import io
from dataclasses import asdict
from fractions import Fraction

import av
import numpy as np
import pytest

from re3.apps.server.export_worker import write
from re3.apps.server.limits import Limits
from re3.video import VideoWriter

TIMES = [0.0, 0.04, 0.08, 0.48, 0.52, 1.0]


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "in.mp4"
    with VideoWriter(path, 25, (96, 64), pixel_aspect=Fraction(2)) as writer:
        for index, moment in enumerate(TIMES):
            writer.write(np.full((64, 96, 3), 40 * index, np.uint8), moment)
    return path


def test_times_and_pixel_aspect_are_kept(video, tmp_path):
    out = tmp_path / "out.mp4"
    frames = [[i, [[1, "car", [10, 10, 20, 20], 0.9, "tracked"]]] for i in range(len(TIMES))]
    job = {
        "source": str(video),
        "path": str(out),
        "fps": [25, 1],
        "size": [96, 64],
        "colours": {},
        "limits": asdict(Limits()),
        "frames": frames,
    }
    write(job, io.BytesIO())
    with av.open(str(out)) as container:
        stream = container.streams.video[0]
        found = [float(frame.pts * stream.time_base) for frame in container.decode(stream)]
        assert stream.sample_aspect_ratio == 2
    np.testing.assert_allclose(found, TIMES, atol=0.002)
