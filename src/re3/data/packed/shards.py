"""Shards of packed training data: the file format, its writer and its reader.

A shard is an uncompressed ZIP archive, complete in itself:

* `index.json`: sources with weights, videos, tracks and stills (`ShardIndex`), and the sampling
  configuration of the mix that it was packed from;
* `videos/NNNNN-P.avif`: the frames of a video, in parts of `FRAMES_PER_PART`;
* `stills/NNNNN.avif`: a picture; `masks/NNNNN.png`: for each pixel the number of the object that
  it shows, from 1; 0 where it shows none.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from collections.abc import Sequence as Several
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from re3.geometry import Floats

FORMAT = "re3-pack"
VERSION = 1
SUFFIX = ".zip"
FRAMES_PER_PART = 100
"""Frames in one file of a shard: what is decoded by one call."""
INDEX = "index.json"


@dataclass(frozen=True)
class PackedSource:
    """A source of the mix.

    Attributes:
        name: empty where tracks and stills go by the names of their datasets.
        kind: `videos` or `stills`.
        weight: among the sources of its kind.
    """

    name: str
    kind: str
    weight: float


@dataclass(frozen=True)
class PackedVideo:
    """Frames of a video.

    Attributes:
        files: in the archive, in order.
        frames: how many there are.
        width, height: of the packed frames in pixels.
    """

    files: tuple[str, ...]
    frames: int
    width: int
    height: int


@dataclass(frozen=True, eq=False)
class PackedTrack:
    """One object in one video.

    Attributes:
        source: index into the sources.
        video: index into the videos of the shard.
        dataset, name: of the sequence.
        first: frame of the packed video that the first box belongs to.
        boxes_xywh: float64 `[T, 4]` in pixels of the packed frames; NaN where the object is absent.
    """

    source: int
    video: int
    dataset: str
    name: str
    first: int
    boxes_xywh: Floats


@dataclass(frozen=True, eq=False)
class PackedStill:
    """A picture with objects.

    Attributes:
        source: index into the sources.
        dataset: name of the dataset.
        file: of the picture, in the archive.
        mask: of the object numbers; None where no outline is known.
        width, height: in pixels.
        boxes_xywh: float64 `[N, 4]` in pixels; N is 0 where nothing is annotated.
        outlines: of each object float64 `[P, 2]`, x and y in pixels, points that span its convex
            hull; None where only the box is known.
    """

    source: int
    dataset: str
    file: str
    mask: str | None
    width: int
    height: int
    boxes_xywh: Floats
    outlines: tuple[Floats | None, ...]


@dataclass(eq=False)
class ShardIndex:
    """What a shard, or all shards together, hold.

    Attributes:
        sources: of the mix, the same in every shard.
        sampling: configuration of the mix, as plain values.
        videos, tracks, stills: in this shard.
    """

    sources: tuple[PackedSource, ...]
    sampling: dict[str, Any]
    videos: list[PackedVideo] = field(default_factory=list)
    tracks: list[PackedTrack] = field(default_factory=list)
    stills: list[PackedStill] = field(default_factory=list)


class ShardWriter:
    """Writes one shard, whole or not at all.

    Args:
        path: of the .zip file.
        sources, sampling: see `ShardIndex`.
    """

    def __init__(
        self, path: Path, sources: tuple[PackedSource, ...], sampling: dict[str, Any]
    ) -> None:
        self.path = path
        self.index = ShardIndex(sources, sampling)
        self._partial = path.with_suffix(".partial")
        self._archive = zipfile.ZipFile(self._partial, "w", zipfile.ZIP_STORED)
        self.bytes = 0

    def add(self, name: str, content: bytes) -> None:
        """Add a file to the archive."""
        # A fixed date: the same data gives the same bytes.
        self._archive.writestr(zipfile.ZipInfo(name), content)
        self.bytes += len(content)

    def close(self) -> None:
        """Write the index and give the shard its name."""
        content = json.dumps(_to_json(self.index), separators=(",", ":"))
        entry = zipfile.ZipInfo(INDEX)
        entry.compress_type = zipfile.ZIP_DEFLATED
        self._archive.writestr(entry, content)
        self._archive.close()
        self._partial.replace(self.path)

    def abandon(self) -> None:
        """Remove what was written so far."""
        self._archive.close()
        self._partial.unlink(missing_ok=True)


class Shard:
    """A shard that was read.

    Args:
        path: of the .zip file.

    Attributes:
        index: what is in it.

    Raises:
        ValueError: not a shard, or one of another version; the message names the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with zipfile.ZipFile(path) as archive:
                content = json.loads(archive.read(INDEX))
            self.index = _from_json(content)
        except (zipfile.BadZipFile, KeyError, TypeError, ValueError) as error:
            raise ValueError(
                f"{path} is not a shard of packed training data ({error}); expected a file that "
                "`re3 data pack` wrote completely"
            ) from error

    def decode_frames(self, file: str) -> NDArray[np.uint8]:
        """The frames in a file of a video, uint8 `[T, H, W, 3]` RGB."""
        from PIL import Image

        with zipfile.ZipFile(self.path) as archive, archive.open(file) as content:
            image = Image.open(io.BytesIO(content.read()))
            frames = []
            for index in range(getattr(image, "n_frames", 1)):
                image.seek(index)
                frames.append(np.asarray(image.convert("RGB")))
        return np.stack(frames)

    def decode_still(self, still: PackedStill) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """A picture, uint8 `[H, W, 3]` RGB, and the object numbers, uint8 `[H, W]`."""
        from PIL import Image

        with zipfile.ZipFile(self.path) as archive:
            picture = np.asarray(Image.open(io.BytesIO(archive.read(still.file))).convert("RGB"))
            if still.mask is None:
                return picture, np.zeros(picture.shape[:2], dtype=np.uint8)
            numbers = np.asarray(Image.open(io.BytesIO(archive.read(still.mask))).convert("L"))
        return picture, numbers


def read_shards(folder: str | Path) -> list[Shard]:
    """All shards in a folder.

    Raises:
        FileNotFoundError: no folder, or no shard in it.
        ValueError: a file that is not a shard, or shards of different mixes.
    """
    folder = Path(folder)
    paths = sorted(folder.glob(f"*{SUFFIX}"))
    if not paths:
        raise FileNotFoundError(
            f"no shards (*{SUFFIX}) in {folder}; write some with `re3 data pack MIX --out {folder}`"
        )
    shards = [Shard(path) for path in paths]
    first = shards[0].index
    for shard in shards[1:]:
        if (shard.index.sources, shard.index.sampling) != (first.sources, first.sampling):
            raise ValueError(
                f"{shard.path} and {shards[0].path} were packed from different mixes; expected "
                "the shards of one mix in a folder"
            )
    return shards


def encode_frames(frames: Several[NDArray[np.uint8]], quality: int) -> bytes:
    """Frames of one size, uint8 `[H, W, 3]` RGB, as an AVIF sequence."""
    from PIL import Image

    first, *others = [Image.fromarray(frame) for frame in frames]
    buffer = io.BytesIO()
    first.save(
        buffer,
        "AVIF",
        save_all=True,
        append_images=others,
        quality=quality,
        speed=8,
        max_threads=1,
    )
    return buffer.getvalue()


def encode_picture(picture: NDArray[np.uint8], quality: int) -> bytes:
    """A picture, uint8 `[H, W, 3]` RGB, as AVIF."""
    return encode_frames([picture], quality)


def encode_numbers(numbers: NDArray[np.uint8]) -> bytes:
    """Object numbers, uint8 `[H, W]`, as PNG."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(numbers).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def decode_all(
    shards: Several[Shard], pool: Executor
) -> Iterator[tuple[Shard, str, NDArray[np.uint8], NDArray[np.uint8] | None]]:
    """Every picture of every shard, decoded in parallel.

    Yields:
        shard, name of the file, uint8 `[T, H, W, 3]` RGB (T is 1 for a still), and the object
        numbers of a still, uint8 `[H, W]`, None for a video.
    """
    for shard in shards:
        files = [file for video in shard.index.videos for file in video.files]
        for file, frames in zip(files, pool.map(shard.decode_frames, files), strict=True):
            yield shard, file, frames, None
        stills = shard.index.stills
        for still, (picture, numbers) in zip(
            stills, pool.map(shard.decode_still, stills), strict=True
        ):
            yield shard, still.file, picture[None], numbers


def _to_json(index: ShardIndex) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "sources": [asdict(source) for source in index.sources],
        "sampling": index.sampling,
        "videos": [asdict(video) for video in index.videos],
        "tracks": [
            {**vars(track), "boxes_xywh": _rounded(track.boxes_xywh)} for track in index.tracks
        ],
        "stills": [
            {
                **vars(still),
                "boxes_xywh": _rounded(still.boxes_xywh),
                "outlines": [None if o is None else _rounded(o) for o in still.outlines],
            }
            for still in index.stills
        ],
    }


def _from_json(content: dict[str, Any]) -> ShardIndex:
    if (content["format"], content["version"]) != (FORMAT, VERSION):
        raise ValueError(
            f"format {content['format']!r}, version {content['version']}; expected {FORMAT!r}, "
            f"version {VERSION}"
        )
    return ShardIndex(
        tuple(PackedSource(**source) for source in content["sources"]),
        content["sampling"],
        [PackedVideo(**{**video, "files": tuple(video["files"])}) for video in content["videos"]],
        [
            PackedTrack(**{**track, "boxes_xywh": _floats(track["boxes_xywh"], 4)})
            for track in content["tracks"]
        ],
        [
            PackedStill(
                **{
                    **still,
                    "boxes_xywh": _floats(still["boxes_xywh"], 4),
                    "outlines": tuple(
                        None if outline is None else _floats(outline, 2)
                        for outline in still["outlines"]
                    ),
                }
            )
            for still in content["stills"]
        ],
    )


def _rounded(values: Floats) -> list[list[float] | None]:
    """Rows as lists of hundredths, None for one of NaN: JSON knows no NaN."""
    return [None if np.isnan(row).any() else np.round(row, 2).tolist() for row in values]


def _floats(rows: list[list[float] | None], columns: int) -> Floats:
    if not rows:
        return np.empty((0, columns))
    return np.array([[np.nan] * columns if row is None else row for row in rows], dtype=np.float64)
