"""Small sequences made on the spot."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from re3.data.sequence import Sequence

NAN = (np.nan,) * 4
REPOSITORY = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, eq=False)
class GivenFrames(Sequence):
    """A sequence whose frames need no file: frame t is 4 x 4 pixels of grey level t."""

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        for index in range(len(self)):
            yield np.full((4, 4, 3), index, np.uint8)


@pytest.fixture
def sequence_of() -> Callable[..., Sequence]:
    """Make a sequence of boxes without any file."""

    def make(boxes, name: str = "clip", dataset: str = "made") -> Sequence:
        return GivenFrames(name, Path(f"{name}.mp4"), np.array(boxes, dtype=float), dataset=dataset)

    return make


@pytest.fixture(scope="session")
def moving_patch() -> tuple[list[NDArray[np.uint8]], NDArray[np.float64]]:
    """Frames and boxes of a textured 40 x 32 patch that moves over a blurred background."""
    random = np.random.default_rng(0)
    background = cv2.resize(random.integers(60, 120, (15, 20, 3)).astype(np.uint8), (160, 120))
    patch = cv2.resize(random.integers(0, 255, (8, 10, 3)).astype(np.uint8), (40, 32))
    images, boxes = [], []
    for index in range(12):
        image = background.copy()
        x, y = 30 + 3 * index, 20 + 2 * index
        image[y : y + 32, x : x + 40] = patch
        images.append(image)
        boxes.append((x, y, 40, 32))
    return images, np.array(boxes, dtype=np.float64)


@pytest.fixture
def clips(tmp_path, moving_patch) -> Path:
    """A folder `made` with two annotated clips, `patch` and `patch-late`."""
    folder = tmp_path / "made"
    images, boxes = moving_patch
    for name, absent in (("patch", 0), ("patch-late", 2)):
        pictures = folder / name
        pictures.mkdir(parents=True)
        for index, image in enumerate(images):
            cv2.imwrite(str(pictures / f"{index:04d}.png"), image)
        lines = [",".join(f"{value:g}" for value in box) for box in boxes]
        lines[:absent] = ["nan,nan,nan,nan"] * absent
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="session")
def peers() -> Path:
    """The folder of peer trackers' files; a test that asks for it is skipped without."""
    given = os.environ.get("RE3_PEERS")
    folder = Path(given) if given else REPOSITORY.parent / "shared" / "peers"
    if not folder.is_dir():
        pytest.skip(f"needs the files of peer trackers: {folder} is not a folder; set RE3_PEERS")
    return folder
