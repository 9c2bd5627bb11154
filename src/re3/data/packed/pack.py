"""Packs the sources of a mix into shards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.mix import Mix
from re3.data.packed.shards import (
    FRAMES_PER_PART,
    SUFFIX,
    PackedSource,
    PackedStill,
    PackedTrack,
    PackedVideo,
    ShardWriter,
    encode_frames,
    encode_numbers,
    encode_picture,
)
from re3.data.sampling import Source
from re3.data.sequence import Sequence
from re3.data.stills import Still
from re3.geometry import Floats
from re3.video import open_source

MEGABYTE = 1_000_000
OUTLINE_POINTS = 32
"""Points that stand for the convex hull of an object: the farthest in so many directions."""
LARGEST_NUMBER = 255
"""Objects of one picture that a mask can number."""


@dataclass(frozen=True)
class PackConfig:
    """How data is packed.

    Attributes:
        longer_side: videos are scaled down to this many pixels, unless `object_side` asks for more.
        object_side: a video is not scaled down so far that the median of its objects' sizes (root
            of the area) falls below this many pixels.
        quality: of the AVIF encoder, 1 to 100.
        shard_mb: size at which a shard is ended, in megabytes.
    """

    longer_side: int = 400
    object_side: float = 40.0
    quality: int = 60
    shard_mb: float = 24.0

    def __post_init__(self) -> None:
        if self.longer_side < 16 or not self.object_side >= 0:
            raise ValueError(
                f"longer_side is {self.longer_side} and object_side {self.object_side}; expected "
                "16 pixels or more, and 0 or more"
            )
        if not 1 <= self.quality <= 100 or not self.shard_mb > 0:
            raise ValueError(
                f"quality is {self.quality} and shard_mb {self.shard_mb}; expected a quality from "
                "1 to 100 and a size above 0"
            )


@dataclass(frozen=True)
class Packed:
    """What was packed so far.

    Attributes:
        done, total: videos and stills.
        shards: that are complete.
        bytes: of all files encoded.
    """

    done: int
    total: int
    shards: int
    bytes: int


def pack(
    mix: Mix,
    sources: list[Source],
    folder: Path,
    config: PackConfig,
    pool: Executor,
    report: Callable[[Packed], None] = lambda packed: None,
) -> Packed:
    """Write all sources as shards `shard-000.zip`, `shard-001.zip` …

    Args:
        mix: whose sampling configuration goes into every shard.
        sources: of the mix, with their tracks and stills.
        folder: of the shards; made if needed, and must hold none yet.
        config: how they are packed.
        pool: encodes in parallel.
        report: called after each video or still.

    Raises:
        FileExistsError: the folder holds shards.
        ValueError, OSError: data that cannot be read; the shards written by then are removed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.glob(f"*{SUFFIX}")):
        raise FileExistsError(f"{folder} holds shards already; give an empty folder, or remove it")
    writer = _Writer(mix, sources, folder, config, report)
    try:
        jobs = _jobs(sources)
        writer.total = len(jobs)
        for item in _encoded(jobs, config, pool):
            writer.add(item)
        writer.close()
    except BaseException:
        writer.abandon()
        raise
    return writer.state()


@dataclass(frozen=True, eq=False)
class _VideoJob:
    source: int
    tracks: list[Sequence]


@dataclass(frozen=True, eq=False)
class _StillJob:
    source: int
    still: Still


@dataclass(frozen=True, eq=False)
class _Encoded:
    """A video with its tracks, or a still, and the contents of its files."""

    contents: list[bytes]
    video: PackedVideo | None = None
    tracks: tuple[PackedTrack, ...] = ()
    still: PackedStill | None = None


class _Writer:
    def __init__(
        self,
        mix: Mix,
        sources: list[Source],
        folder: Path,
        config: PackConfig,
        report: Callable[[Packed], None],
    ) -> None:
        self.folder, self.config, self.report = folder, config, report
        self.sources = tuple(
            PackedSource(source.name, "videos" if source.sequences else "stills", source.weight)
            for source in sources
        )
        self.sampling: dict[str, Any] = asdict(mix.sampling)
        self.done = self.total = self.bytes = 0
        self.paths: list[Path] = []
        self._shard: ShardWriter | None = None

    def state(self) -> Packed:
        return Packed(self.done, self.total, len(self.paths), self.bytes)

    def add(self, item: _Encoded) -> None:
        size = sum(map(len, item.contents))
        limit = self.config.shard_mb * MEGABYTE
        if self._shard is not None and self._shard.bytes + size > limit:
            self.close()
        if self._shard is None:
            path = self.folder / f"shard-{len(self.paths):03}{SUFFIX}"
            self._shard = ShardWriter(path, self.sources, self.sampling)
        shard, index = self._shard, self._shard.index
        if item.video is not None:
            number = len(index.videos)
            files = tuple(f"videos/{number:05}-{i}.avif" for i in range(len(item.contents)))
            for file, content in zip(files, item.contents, strict=True):
                shard.add(file, content)
            index.videos.append(replace(item.video, files=files))
            index.tracks += [replace(track, video=number) for track in item.tracks]
        if item.still is not None:
            number = len(index.stills)
            file, mask = f"stills/{number:05}.avif", None
            shard.add(file, item.contents[0])
            if len(item.contents) > 1:
                mask = f"masks/{number:05}.png"
                shard.add(mask, item.contents[1])
            index.stills.append(replace(item.still, file=file, mask=mask))
        self.done += 1
        self.bytes += size
        self.report(self.state())

    def close(self) -> None:
        if self._shard is not None:
            self._shard.close()
            self.paths.append(self._shard.path)
            self._shard = None

    def abandon(self) -> None:
        if self._shard is not None:
            self._shard.abandon()
        for path in self.paths:
            path.unlink(missing_ok=True)


def _jobs(sources: list[Source]) -> list[_VideoJob | _StillJob]:
    """The videos of all sources, each with all of its tracks, then the stills."""
    videos: dict[tuple[int, Path], list[Sequence]] = {}
    for index, source in enumerate(sources):
        for sequence in source.sequences:
            videos.setdefault((index, sequence.source), []).append(sequence)
    stills = [_StillJob(index, s) for index, source in enumerate(sources) for s in source.stills]
    return [*(_VideoJob(index, tracks) for (index, _), tracks in videos.items()), *stills]


def _encoded(
    jobs: list[_VideoJob | _StillJob], config: PackConfig, pool: Executor
) -> Iterator[_Encoded]:
    """The jobs, encoded in order, a few ahead of the one that is yielded."""
    ahead = 8
    futures = [pool.submit(_encode, job, config) for job in jobs[:ahead]]
    for index in range(len(jobs)):
        if index + ahead < len(jobs):
            futures.append(pool.submit(_encode, jobs[index + ahead], config))
        yield futures[index].result()
        futures[index].cancel()
        futures[index] = None  # type: ignore[call-overload]  # frees the bytes


def _encode(job: _VideoJob | _StillJob, config: PackConfig) -> _Encoded:
    return _encode_video(job, config) if isinstance(job, _VideoJob) else _encode_still(job, config)


def _encode_video(job: _VideoJob, config: PackConfig) -> _Encoded:
    """The frames from the first track's first to the last one's last, scaled."""
    begin = min(track.start_frame for track in job.tracks)
    end = max(track.start_frame + len(track) for track in job.tracks)
    sizes = np.concatenate([t.boxes_xywh[t.annotated][:, 2:].prod(axis=1) for t in job.tracks])
    scale: float | None = None
    part: list[NDArray[np.uint8]] = []
    contents: list[bytes] = []
    frames, side = 0, (0, 0)
    with open_source(job.tracks[0].source) as source:
        for index, frame in enumerate(source):
            if index < begin:
                continue
            if index >= end:
                break
            height, width = frame.image.shape[:2]
            if scale is None:
                scale = config.longer_side / max(width, height)
                if len(sizes):
                    scale = max(scale, config.object_side / float(np.sqrt(np.median(sizes))))
                scale = min(scale, 1.0)
                side = max(1, round(width * scale)), max(1, round(height * scale))
                scales = np.array([side[0] / width, side[1] / height] * 2)
            shrunk = frame.image if scale == 1.0 else _shrunk(frame.image, side)
            if shrunk.shape[1::-1] != side:
                raise ValueError(
                    f"{job.tracks[0].source}: frame {index} is {width} x {height}; expected all "
                    "frames of a video to be of one size"
                )
            part.append(np.ascontiguousarray(shrunk[..., ::-1]))
            frames += 1
            if len(part) == FRAMES_PER_PART:
                contents.append(encode_frames(part, config.quality))
                part = []
    if part:
        contents.append(encode_frames(part, config.quality))
    if scale is None:
        raise ValueError(f"{job.tracks[0].source} ends before its first box, at frame {begin}")
    tracks = []
    for track in job.tracks:
        first = track.start_frame - begin
        boxes = track.boxes_xywh[: max(0, frames - first)] * scales
        if len(boxes):
            tracks.append(PackedTrack(job.source, 0, track.dataset, track.name, first, boxes))
    return _Encoded(contents, PackedVideo((), frames, *side), tuple(tracks))


def _shrunk(image: NDArray[np.uint8], side: tuple[int, int]) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(image, side, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _encode_still(job: _StillJob, config: PackConfig) -> _Encoded:
    still = job.still
    picture = still.read()
    height, width = picture.shape[:2]
    size = np.array([width, height, width, height])
    boxes = (still.boxes_xywh * size if still.relative else still.boxes_xywh)[:LARGEST_NUMBER]
    numbers = np.zeros((height, width), dtype=np.uint8)
    outlines: list[Floats | None] = []
    for number, (box, mask) in enumerate(zip(boxes, still.masks, strict=False), start=1):
        outline = None
        if mask is not None:
            try:
                alpha = mask.read(width, height) > 127
            except ValueError as error:
                raise ValueError(f"{still.image}: {error}") from error
            inside = _inside(alpha, box)
            outline = _outline(inside)
            numbers[inside] = number
        outlines.append(outline)
    contents = [encode_picture(np.ascontiguousarray(picture[..., ::-1]), config.quality)]
    if any(outline is not None for outline in outlines):
        contents.append(encode_numbers(numbers))
    packed = PackedStill(job.source, still.dataset, "", None, width, height, boxes, tuple(outlines))
    return _Encoded(contents, still=packed)


def _inside(alpha: NDArray[np.bool_], box_xywh: Floats) -> NDArray[np.bool_]:
    """The part of a mask within the box: one mask may be that of several objects."""
    x, y, w, h = box_xywh
    kept = np.zeros_like(alpha)
    rows = slice(max(0, round(y)), max(0, round(y + h)))
    columns = slice(max(0, round(x)), max(0, round(x + w)))
    kept[rows, columns] = alpha[rows, columns]
    return kept


def _outline(alpha: NDArray[np.bool_]) -> Floats | None:
    """The farthest corners of pixels in `OUTLINE_POINTS` directions, `[P, 2]`; None if empty."""
    edge = alpha & ~(
        np.roll(alpha, 1, 0) & np.roll(alpha, -1, 0) & np.roll(alpha, 1, 1) & np.roll(alpha, -1, 1)
    )
    rows, columns = np.nonzero(edge)
    if not len(rows):
        return None
    points = np.stack([columns, rows], axis=1)
    corners = np.concatenate([points + offset for offset in ((0, 0), (1, 0), (0, 1), (1, 1))])
    angles = np.arange(OUTLINE_POINTS) * 2 * np.pi / OUTLINE_POINTS
    directions = np.stack([np.cos(angles), np.sin(angles)])
    return corners[np.argmax(corners @ directions, axis=0)].astype(np.float64)
