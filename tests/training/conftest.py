import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs torch (the train extra)")

from re3.data.clip import RecordedClip


class TinySampler:
    """Clips of a bright square that walks over noise."""

    sequences = ()
    stills = ()

    def sample(self, frames, rng):
        background = rng.integers(0, 100, (60, 80, 3), dtype=np.uint8)
        x, y = rng.uniform(10, 50), rng.uniform(10, 30)
        velocity = rng.normal(0, 2, 2)
        images, boxes = [], []
        for t in range(frames):
            left, top = (round(float(v)) for v in np.array([x, y]) + velocity * t)
            left, top = int(np.clip(left, 0, 64)), int(np.clip(top, 0, 44))
            image = background.copy()
            image[top : top + 16, left : left + 16] = 230
            images.append(image)
            boxes.append((left, top, left + 16, top + 16))
        return RecordedClip(images, boxes, (127.0,) * 3)


@pytest.fixture
def sampler():
    return TinySampler()
