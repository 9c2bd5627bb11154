"""A film and pictures to pack."""

import cv2
import numpy as np

from re3.data.masks import MaskImage
from re3.data.sampling import Source
from re3.data.sequence import Sequence
from re3.data.stills import Still
from re3.video import VideoWriter


def make_sources(folder):
    """A video of a bright square, 130 frames of 160 x 96, and three stills of a disc."""
    path = folder / "clip.mp4"
    boxes = []
    rng = np.random.default_rng(0)
    background = cv2.resize(rng.integers(30, 120, (12, 20, 3), dtype=np.uint8), (160, 96))
    with VideoWriter(path, 25, (160, 96)) as writer:
        for t in range(130):
            frame = background.copy()
            left = 10 + t % 100
            frame[30:54, left : left + 24] = (40, 200, 250)
            boxes.append((left, 30.0, 24.0, 24.0) if t % 50 != 7 else (np.nan,) * 4)
            writer.write(frame)
    track = Sequence("clip", path, np.array(boxes), dataset="squares")
    stills = []
    for index in range(3):
        picture = cv2.resize(rng.integers(0, 90, (10, 14, 3), dtype=np.uint8), (140, 100))
        mask = np.zeros((100, 140), np.uint8)
        cv2.ellipse(mask, (70, 50), (30, 20), 20.0 * index, 0, 360, 255, -1)
        picture[mask > 0] = (60, 220, 30)
        cv2.imwrite(str(folder / f"{index}.png"), picture)
        cv2.imwrite(str(folder / f"{index}-mask.png"), mask)
        rows, columns = np.nonzero(mask)
        low, high = (columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)
        box = np.array([[*low, high[0] - low[0], high[1] - low[1]]], dtype=np.float64)
        outline = MaskImage(folder / f"{index}-mask.png")
        stills.append(Still(folder / f"{index}.png", box, (outline,), dataset="discs"))
    return [
        Source("films", sequences=[track], weight=2.0),
        Source("pictures", stills=stills, weight=1.0),
    ]
