"""Decoded frames of training videos, kept on disk and mapped into memory.

Training reads short windows at random places, for which a video decoder would have to start from
a key frame each time. Each video is decoded once into one array file; memory is bounded by the
operating system's page cache, the disk by `limit_gb`: the files that were used longest ago go
first. Processes may share a folder.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Lock
from typing import BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.video import open_source
from re3.video.images import sorted_images

DEFAULT_LIMIT_GB = 100.0
GIGABYTE = 1e9
KEPT_FREE = 1.0
"""Gigabytes of the disk that are left to others."""

ATTEMPTS = 3
"""Times that a video is decoded when others remove it at once."""
ABANDONED = 24 * 3600.0
"""Seconds after which a half-written file is taken for one of a process that was killed."""

SAMPLE = 65536
"""Bytes read at the start, in the middle and at the end of a file to tell it from others."""

Stored = tuple[NDArray[np.uint8], float]


class CacheFullError(OSError):
    """A video does not fit into the cache of decoded frames, or on its disk."""


def default_folder() -> Path:
    """`$RE3_CACHE/frames`, by default `~/.cache/re3/frames`."""
    root = os.environ.get("RE3_CACHE")
    return (Path(root) if root else Path.home() / ".cache" / "re3") / "frames"


class FrameStore:
    """Random access to the frames of videos.

    Args:
        folder: where the array files go; made if needed.
        longest_side: frames with a longer side are shrunk to this many pixels.
        limit_gb: gigabytes that the files may take together.

    Raises:
        ValueError: the limit is not above 0.
    """

    def __init__(
        self,
        folder: str | Path | None = None,
        longest_side: int = 640,
        limit_gb: float = DEFAULT_LIMIT_GB,
    ) -> None:
        if not limit_gb > 0:
            raise ValueError(f"a cache of {limit_gb} GB; expected more than 0")
        self.folder = Path(folder) if folder is not None else default_folder()
        self.longest_side = longest_side
        self.limit = int(limit_gb * GIGABYTE)
        self._lock = Lock()
        self._making: dict[Path, Lock] = {}
        self._open: dict[Path, tuple[Path, Stored]] = {}
        self._sizes: dict[Path, tuple[int, int]] = {}
        self._images: dict[Path, list[Path]] = {}
        self._paths: dict[Path, Path] = {}

    def frames(self, source: Path) -> tuple[NDArray[np.uint8], float]:
        """All frames of a video or a folder of images.

        Returns:
            uint8 `[T, H, W, 3]` BGR, mapped from disk, and the scale that boxes in pixels of the
            source have to be multiplied with.

        Raises:
            CacheFullError: they do not fit into the cache or on the disk.
            ValueError: frames of several sizes, or what `re3.video.open_source` raises.
        """
        # Clips are drawn by several threads: each video is decoded by one of them.
        with self._lock:
            making = self._making.setdefault(source, Lock())
        with making:
            kept = self._kept(source)
            if kept is None:
                path = self._path(source)
                kept = self._stored(source, path), self.scale(source)
                with self._lock:
                    self._open[source] = (path, kept)
            return kept

    def _stored(self, source: Path, path: Path) -> NDArray[np.uint8]:
        for _ in range(ATTEMPTS):
            if not path.exists():
                self._decode(source, path)
            try:
                frames: NDArray[np.uint8] = np.load(path, mmap_mode="r")
                _mark_used(path)
            except FileNotFoundError:
                # Another thread or process has just made room for a video of its own.
                continue
            return frames
        raise CacheFullError(
            f"{path} was removed {ATTEMPTS} times as soon as it was made: the cache is too small "
            "for what runs at the same time; raise its limit with --cache-gb"
        )

    def read(self, source: Path, indices: NDArray[np.int64]) -> list[NDArray[np.uint8]]:
        """Some frames of a video or a folder of images, past its end the last one.

        Images of a folder are read one by one where the cache has no room left for all of them;
        a video makes room for itself. Raises as `frames` does.
        """
        if source.is_dir() and self._kept(source) is None and not self._has_room(source):
            images = self._images_of(source)
            return [self._image(source, images[min(i, len(images) - 1)]) for i in indices]
        frames, _ = self.frames(source)
        return [frames[min(i, len(frames) - 1)] for i in indices]

    def scale(self, source: Path) -> float:
        """What boxes in pixels of a source have to be multiplied with; nothing is stored."""
        return min(1.0, self.longest_side / max(self._size(source)))

    def _size(self, source: Path) -> tuple[int, int]:
        """Width and height of the source's first frame."""
        if source not in self._sizes:
            with open_source(source) as frames:
                self._sizes[source] = frames.size
        return self._sizes[source]

    def _stored_size(self, source: Path) -> tuple[int, int]:
        (width, height), scale = self._size(source), self.scale(source)
        return (round(width * scale), round(height * scale)) if scale < 1.0 else (width, height)

    def _images_of(self, folder: Path) -> list[Path]:
        if folder not in self._images:
            self._images[folder] = sorted_images(folder.iterdir())
        return self._images[folder]

    def _path(self, source: Path) -> Path:
        if source not in self._paths:
            # Neither where it lies nor when it was written: a dataset that is fetched anew, moved
            # or touched would be decoded again, and what was made of it before would be left over.
            digest = hashlib.sha256(f"{self.longest_side}|".encode())
            digest.update(
                _content(self._images_of(source)) if source.is_dir() else _sampled(source)
            )
            self._paths[source] = self.folder / f"{source.stem}-{digest.hexdigest()[:20]}.npy"
        return self._paths[source]

    def _kept(self, source: Path) -> Stored | None:
        """What is open, marked as used now; None where it is not, or was removed meanwhile."""
        with self._lock:
            if source not in self._open:
                return None
            path, kept = self._open[source]
            try:
                _mark_used(path)
            except FileNotFoundError:  # by another process; its space is ours until we let it go
                del self._open[source]
                return None
            return kept

    def _has_room(self, folder: Path) -> bool:
        """Whether a folder's images are stored, or can be without removing others."""
        if self._path(folder).exists():
            return True
        width, height = self._stored_size(folder)
        needed = width * height * 3 * len(self._images_of(folder))
        return needed <= min(self.limit - sum(size for _, size, _ in self._files()), self._free())

    def _decode(self, source: Path, path: Path) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        with open_source(source) as frames:
            width, height = self._stored_size(source)
            expected = width * height * 3 * (frames.frame_count or 0)
        self._make_room(expected, source)
        partial = path.with_suffix(f".{os.getpid()}.partial")
        try:
            with partial.open("wb") as file:
                written = self._write(source, file)
            # What a video says of its length may be wrong.
            self._make_room(written, source, written)
            partial.replace(path)
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise self._full(source, expected) from error
            raise
        finally:
            partial.unlink(missing_ok=True)

    def _write(self, source: Path, file: BinaryIO) -> int:
        """Write the frames one by one as an array file; returns its size in bytes."""
        size = self._stored_size(source)
        shape = (size[1], size[0], 3)
        _write_header(file, (0, *shape))
        start, count = file.tell(), 0
        for image in self._decoded(source, size):
            file.write(np.ascontiguousarray(image).data)
            count += 1
            if file.tell() > self.limit:
                raise self._full(source, file.tell())
        end = file.tell()
        file.seek(0)
        # numpy leaves room in the header for the first axis to grow.
        _write_header(file, (count, *shape))
        assert file.tell() == start, "the header of an array file must not grow with its length"
        return end

    def _decoded(self, source: Path, size: tuple[int, int]) -> Iterator[NDArray[np.uint8]]:
        with open_source(source, skip_broken=False) as frames:
            for index, frame in enumerate(frames):
                height, width = frame.image.shape[:2]
                if (width, height) != frames.size:
                    raise ValueError(
                        f"{source}: frame {index} has {width} x {height} pixels, but the first "
                        f"{frames.size[0]} x {frames.size[1]}; expected one size for training"
                    )
                yield self._shrunk(frame.image, size)

    def _image(self, folder: Path, path: Path) -> NDArray[np.uint8]:
        with open_source(path) as frames:
            (frame,) = frames
        return self._shrunk(frame.image, self._stored_size(folder))

    @staticmethod
    def _shrunk(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
        if image.shape[1::-1] == size:
            return image
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def _files(self) -> list[tuple[int, int, Path]]:
        """When each array file was last used, in ns, its bytes and its path; oldest first."""
        found = []
        for path in self.folder.glob("*.npy"):
            try:
                stat = path.stat()
            except FileNotFoundError:  # removed by another process just now
                continue
            found.append((stat.st_atime_ns, stat.st_size, path))
        return sorted(found)

    def _free(self) -> int:
        """Bytes of the disk that may be used."""
        folder = next(path for path in (self.folder, *self.folder.parents) if path.exists())
        return shutil.disk_usage(folder).free - int(KEPT_FREE * GIGABYTE)

    def _make_room(self, needed: int, source: Path, written: int = 0) -> None:
        """Remove the files used longest ago until so many bytes fit.

        Args:
            needed: bytes of the file to come.
            source: what it is made from.
            written: bytes of it that are on the disk already.
        """
        with self._lock:
            for path in self.folder.glob("*.partial"):
                if time.time() - path.stat().st_mtime > ABANDONED:
                    path.unlink(missing_ok=True)
            files = self._files()
            total, free = sum(size for _, size, _ in files), self._free() + written
            for _, size, path in files:
                if total + needed <= self.limit and needed <= free:
                    break
                path.unlink(missing_ok=True)
                self._open = {s: kept for s, kept in self._open.items() if kept[0] != path}
                total, free = total - size, free + size
            if needed > self.limit or needed > free:
                raise self._full(source, needed)

    def _full(self, source: Path, needed: int) -> CacheFullError:
        return CacheFullError(
            f"{source} takes {needed / GIGABYTE:.1f} GB or more when decoded; the cache "
            f"{self.folder} may hold {self.limit / GIGABYTE:.1f} GB, and its disk has "
            f"{max(self._free(), 0) / GIGABYTE:.1f} GB to spare. Raise the limit with --cache-gb, "
            "free some space, set RE3_CACHE to a folder on a larger disk, or cut the video up"
        )


def _mark_used(path: Path) -> None:
    # Not left to the file system: most do not note every access, and reads through a map never.
    os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))


def _content(images: list[Path]) -> bytes:
    """What tells a folder of images from others, and from itself once it is changed."""
    listed = "|".join(f"{path.name}:{path.stat().st_size}" for path in images)
    sampled = {images[0], images[len(images) // 2], images[-1]} if images else set()
    return listed.encode() + b"".join(_sampled(path) for path in sorted(sampled))


def _sampled(path: Path) -> bytes:
    """A file's size, and `SAMPLE` bytes at its start, in its middle and at its end."""
    size = path.stat().st_size
    with path.open("rb") as file:
        parts = [str(size).encode()]
        for start in (0, (size - SAMPLE) // 2, size - SAMPLE):
            file.seek(max(start, 0))
            parts.append(file.read(SAMPLE))
    return b"|".join(parts)


def _write_header(file: BinaryIO, shape: tuple[int, ...]) -> None:
    np.lib.format.write_array_header_1_0(
        file, {"descr": "|u1", "fortran_order": False, "shape": shape}
    )
