import av
import numpy as np
import pytest

from re3.video import VideoWriter


@pytest.fixture
def noise(tmp_path):
    """A clip that cannot be compressed to nothing, so that damage hits frames."""
    path = tmp_path / "noise.mp4"
    random = np.random.default_rng(0)
    with VideoWriter(path, 25, (64, 48)) as writer:
        for _ in range(40):
            writer.write(random.integers(0, 255, (48, 64, 3), np.uint8))
    return path


@pytest.fixture
def encode(tmp_path):
    """Writes frames, uint8 `[H, W, 3]` BGR, into a new file of the folder; returns its path."""

    def write(name, images, codec="libx264", pts=None, time_base=None, options=None, aspect=None):
        path = tmp_path / name
        with av.open(str(path), "w", options=options or {}) as container:
            stream = container.add_stream(codec, rate=25)
            stream.height, stream.width = images[0].shape[:2]
            stream.pix_fmt = "yuv420p"
            if time_base is not None:
                stream.codec_context.time_base = time_base
            if aspect is not None:
                stream.codec_context.sample_aspect_ratio = aspect
            for index, image in enumerate(images):
                frame = av.VideoFrame.from_ndarray(image, format="bgr24")
                if pts is not None:
                    frame.pts, frame.time_base = pts[index], time_base
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        return path

    return write
