"""What can be taken away from a session: the boxes in files of many kinds, and a video."""

from __future__ import annotations

import asyncio
import json
import os
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path

from re3.apps.server.limits import Limits
from re3.apps.server.remote_video import ENVIRONMENT
from re3.apps.server.wire import Head
from re3.result import Result
from re3.video import SourceError, open_results
from re3.video.draw import Colour


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        ending: of its name; chooses the writer.
        media_type: as HTTP has it.
        title: for people.
    """

    ending: str
    media_type: str
    title: str


KINDS = {
    "csv": Kind(".csv", "text/csv; charset=utf-8", "CSV"),
    "json": Kind(".json", "application/json", "JSON"),
    "otb": Kind(".txt", "text/plain; charset=utf-8", "OTB text"),
    "mot": Kind(".mot.txt", "text/plain; charset=utf-8", "MOTChallenge text"),
    "coco": Kind(".coco.json", "application/json", "COCO-style JSON"),
    "mp4": Kind(".mp4", "video/mp4", "MP4 with boxes"),
}


@dataclass(frozen=True)
class Tracks:
    """What was found, apart from the session that goes on.

    Attributes:
        frames: index, timestamp and results, in order.
        size: of the frames.
        fps: of the video.
        colours: by object.
    """

    frames: list[tuple[int, float, list[Result]]]
    size: tuple[int, int]
    fps: Fraction
    colours: dict[int, Colour]


def write_boxes(tracks: Tracks, kind: Kind, folder: Path, stem: str) -> Path:
    """Write the boxes; several files (OTB text of several objects) come in a ZIP.

    Raises:
        ValueError: nothing has been tracked.
    """
    _check(tracks)
    with open_results(folder / f"{stem}{kind.ending}") as writer:
        writer.frame_size = tracks.size
        for index, timestamp, results in tracks.frames:
            writer.write(index, timestamp, results)
    if len(writer.paths) == 1:
        return writer.paths[0]
    packed = folder / f"{stem}.zip"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        for path in writer.paths:
            file.write(path, path.name)
    return packed


async def write_video(
    tracks: Tracks,
    source: Path,
    folder: Path,
    stem: str,
    limits: Limits,
    progress: Callable[[float], None],
) -> Path:
    """Write the frames with the boxes drawn in, by a process of its own.

    Where the task is cancelled, the process ends.

    Args:
        tracks: what was found.
        source: video file, or folder of pictures.
        folder: for the file and what is needed to make it.
        stem: of the file's name.
        limits: of the server.
        progress: called with the share that is done, 0 to 1.

    Raises:
        ValueError: nothing has been tracked, or a frame cannot be read any more.
        OSError: the file cannot be written.
    """
    _check(tracks)
    path, job = folder / f"{stem}.mp4", folder / "job.json"
    await asyncio.to_thread(_write_job, job, tracks, source, path, limits)
    worker = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "re3.apps.server.export_worker",
        str(job),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        env={**os.environ, **ENVIRONMENT},
    )
    assert worker.stdout is not None
    try:
        while not (said := await _message(worker.stdout)).get("finished"):
            if "error" in said:
                if said["errno"] is not None:
                    raise OSError(said["errno"], os.strerror(said["errno"]))
                raise SourceError(said["error"])
            progress(said["frames"] / len(tracks.frames))
    finally:
        with suppress(ProcessLookupError):
            worker.kill()
        await worker.wait()
    return path


def _write_job(job: Path, tracks: Tracks, source: Path, path: Path, limits: Limits) -> None:
    frames = [
        [index, [[r.object_id, r.name, r.box_xywh, r.score, r.status.value] for r in results]]
        for index, _, results in tracks.frames
    ]
    told = {
        "source": str(source),
        "path": str(path),
        "fps": tracks.fps.as_integer_ratio(),
        "size": tracks.size,
        "colours": tracks.colours,
        "limits": asdict(limits),
        "frames": frames,
    }
    job.write_text(json.dumps(told), encoding="utf-8")


async def _message(pipe: asyncio.StreamReader) -> Head:
    try:
        length = int.from_bytes(await pipe.readexactly(4), "big")
        said: Head = json.loads(await pipe.readexactly(length))
    except asyncio.IncompleteReadError as error:
        raise SourceError(
            "the process that writes the video crashed; the video is damaged or too large for this "
            "machine's memory"
        ) from error
    return said


def bgr(css: str) -> Colour:
    """`#rrggbb` as OpenCV has it."""
    red, green, blue = _pairs(css)
    return blue, green, red


def _pairs(css: str) -> Iterator[int]:
    return (int(css[at : at + 2], 16) for at in (1, 3, 5))


def _check(tracks: Tracks) -> None:
    if not tracks.frames:
        raise ValueError("nothing has been tracked yet; draw a box first")
