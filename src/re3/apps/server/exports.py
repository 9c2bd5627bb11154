"""What can be taken away from a session: the boxes in files of many kinds, and a video."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from re3.apps.server.limits import Limits
from re3.apps.server.remote_video import RemoteVideo
from re3.result import Result
from re3.video import SourceError, VideoWriter, draw_results, open_results
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


def write_video(tracks: Tracks, source: Path, folder: Path, stem: str, limits: Limits) -> Path:
    """Write the frames with the boxes drawn in, decoded once more by a process of its own.

    Raises:
        ValueError: nothing has been tracked, or a frame cannot be read any more.
    """
    _check(tracks)
    path = folder / f"{stem}.mp4"
    video = RemoteVideo(limits)
    try:
        video.open(source, pictures=source.is_dir())
        with VideoWriter(path, tracks.fps, tracks.size) as writer:
            for index, _, results in tracks.frames:
                frame = video.read(index)
                if frame is None:
                    raise SourceError(f"frame {index} cannot be read any more")
                writer.write(draw_results(frame.image, results, tracks.colours))
    finally:
        video.close()
    return path


def bgr(css: str) -> Colour:
    """`#rrggbb` as OpenCV has it."""
    red, green, blue = _pairs(css)
    return blue, green, red


def _pairs(css: str) -> Iterator[int]:
    return (int(css[at : at + 2], 16) for at in (1, 3, 5))


def _check(tracks: Tracks) -> None:
    if not tracks.frames:
        raise ValueError("nothing has been tracked yet; draw a box first")
