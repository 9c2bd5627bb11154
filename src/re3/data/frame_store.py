"""Decoded frames of training videos, kept on disk and mapped into memory.

Training reads short windows at random places, for which a video decoder would have to start from
a key frame each time. Each video is decoded once into one array file; the operating system's page
cache then is the cache, bounded by the machine's free memory.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.video import open_source


def default_folder() -> Path:
    """`$RE3_CACHE/frames`, by default `~/.cache/re3/frames`."""
    root = os.environ.get("RE3_CACHE")
    return (Path(root) if root else Path.home() / ".cache" / "re3") / "frames"


class FrameStore:
    """Random access to the frames of videos.

    Args:
        folder: where the array files go; made if needed.
        longest_side: frames with a longer side are shrunk to this many pixels.
    """

    def __init__(self, folder: str | Path | None = None, longest_side: int = 640) -> None:
        self.folder = Path(folder) if folder is not None else default_folder()
        self.longest_side = longest_side
        self._lock = Lock()
        self._open: dict[Path, tuple[NDArray[np.uint8], float]] = {}

    def frames(self, source: Path) -> tuple[NDArray[np.uint8], float]:
        """All frames of a video or a folder of images.

        Returns:
            uint8 `[T, H, W, 3]` BGR, mapped from disk, and the scale that boxes in pixels of the
            source have to be multiplied with.

        Raises:
            ValueError: frames of several sizes, or what `re3.video.open_source` raises.
        """
        with self._lock:  # clips are drawn by several threads
            if source not in self._open:
                self._open[source] = self._load(source)
            return self._open[source]

    def _load(self, source: Path) -> tuple[NDArray[np.uint8], float]:
        stat = source.stat()
        identity = f"{source.resolve()}|{stat.st_size}|{stat.st_mtime_ns}|{self.longest_side}"
        digest = hashlib.sha256(identity.encode()).hexdigest()[:20]
        path = self.folder / f"{source.stem}-{digest}.npy"
        with open_source(source) as frames:
            width, height = frames.size
            scale = min(1.0, self.longest_side / max(width, height))
            if not path.exists():
                images = [frame.image for frame in frames]
        if not path.exists():
            shapes = {image.shape for image in images}
            if len(shapes) != 1:
                raise ValueError(
                    f"{source} has frames of {len(shapes)} sizes; expected one size for training"
                )
            if scale < 1.0:
                size = (round(width * scale), round(height * scale))
                images = [cv2.resize(i, size, interpolation=cv2.INTER_AREA) for i in images]
            self.folder.mkdir(parents=True, exist_ok=True)
            partial = path.with_suffix(f".{os.getpid()}.partial")
            with partial.open("wb") as file:
                np.save(file, np.stack(images))
            partial.replace(path)
        return np.load(path, mmap_mode="r"), scale
