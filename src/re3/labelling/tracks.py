"""The folder of labelled tracks, in the plain form that training reads."""

from __future__ import annotations

import json
from collections.abc import Sequence as Several
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path
from typing import Any

from re3.data import plain
from re3.data.sequence import Sequence
from re3.evaluation.result_files import write_whole
from re3.labelling.config import LabelConfig
from re3.labelling.videos import LabelledTrack
from re3.natural_order import natural_key
from re3.video.writer import VideoWriter

VIDEO_SUFFIXES = plain.VIDEO_SUFFIXES | {".gif"}
LOG = "labelled.jsonl"
"""Settings in the first line, then a line for each video that is done."""


class TrackFolder:
    """Writes tracks, and remembers which videos are done.

    Labelling that was stopped goes on with the same folder: a video is either in the log with all
    its tracks, or labelled again, which writes the same files again.

    Args:
        folder: made if needed.
        settings: what the tracks depend on; JSON types.

    Attributes:
        path: of the folder.

    Raises:
        ValueError: the folder has tracks of other settings, or its log is broken.
        OSError: it cannot be read or made.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self.path = folder
        self._log = folder / LOG
        self._lines = [json.dumps({"settings": settings})]
        self._done: dict[str, int] = {}
        if self._log.is_file():
            self._read(settings)

    def tracks_of(self, name: str) -> int | None:
        """Number of tracks of a video that is done, None where it is not."""
        return self._done.get(name)

    def write(self, name: str, tracks: Several[LabelledTrack], fps: Fraction) -> None:
        """Write the tracks of a video and enter it in the log.

        Args:
            name: of the video, a relative path without suffix.
            tracks: `<name>-<first frame>-<number>.mp4` and `.txt` each.
            fps: frames a second.

        Raises:
            OSError: a file cannot be written; the video is then not in the log.
        """
        clips = []
        for number, track in enumerate(tracks):
            clip = f"{name}-{track.first_frame:06d}-{number}"
            rows = (",".join(f"{side:.2f}" for side in box) for box in track.boxes_xywh)
            write_whole(self.path / f"{clip}.txt", "".join(f"{row}\n" for row in rows))
            height, width = track.frames[0].shape[:2]
            with VideoWriter(self.path / f"{clip}.mp4", fps, (width, height)) as video:
                for frame in track.frames:
                    video.write(frame)
            clips.append({"clip": f"{clip}.mp4", "agreement": round(track.agreement, 3)})
        self._lines.append(json.dumps({"video": name, "tracks": clips}, ensure_ascii=False))
        write_whole(self._log, "".join(f"{line}\n" for line in self._lines))
        self._done[name] = len(clips)

    def _read(self, settings: dict[str, Any]) -> None:
        lines = self._log.read_text(encoding="utf-8").splitlines()
        try:
            head, *videos = [json.loads(line) for line in lines if line.strip()]
            earlier = head["settings"]
            self._done = {video["video"]: len(video["tracks"]) for video in videos}
        except (ValueError, TypeError, KeyError) as error:
            raise ValueError(
                f"{self._log} is not the log of labelled tracks ({error!r}); "
                "give another folder, or remove the file to label all videos again"
            ) from error
        if earlier != settings:
            other = sorted(
                key for key in {*earlier, *settings} if earlier.get(key) != settings.get(key)
            )
            raise ValueError(
                f"{self.path} has tracks that were labelled with another "
                + ", ".join(f"{key} ({earlier.get(key)}, now {settings.get(key)})" for key in other)
                + "; give the same options to go on, or another folder"
            )
        self._lines = [line for line in lines if line.strip()]


def settings_of(config: LabelConfig, teacher: str, second: str, given: bool) -> dict[str, Any]:
    """What tracks depend on, as `TrackFolder` keeps it."""
    return {"teacher": teacher, "second": second, "given boxes": given, **asdict(config)}


def find_videos(paths: Several[Path], out: Path) -> dict[str, Path]:
    """The videos to label, by the name that their tracks get.

    Args:
        paths: video files, and folders that are searched with all below.
        out: where the tracks go.

    Returns:
        files by their path relative to the folder given, without suffix, in natural order.

    Raises:
        ValueError: no video, another kind of file, two videos of one name, or `out` is inside of
            a folder.
        FileNotFoundError: a path does not exist.
    """
    found: dict[str, Path] = {}
    kinds = ", ".join(sorted(VIDEO_SUFFIXES))
    for path in paths:
        if not path.exists():
            raise FileNotFoundError(f"{path} does not exist; expected a video or a folder of them")
        if path.is_dir() and out.resolve().is_relative_to(path.resolve()):
            raise ValueError(
                f"{out} is inside of {path}, whose videos are to be labelled: its tracks would be "
                "labelled the next time; give a folder elsewhere"
            )
        videos = _videos_below(path) if path.is_dir() else [path]
        if not videos or videos[0].suffix.lower() not in VIDEO_SUFFIXES:
            raise ValueError(f"{path} is not a video and holds none; expected files in {kinds}")
        for video in videos:
            name = video.relative_to(path) if path.is_dir() else Path(video.name)
            key = name.with_suffix("").as_posix()
            if key in found:
                raise ValueError(
                    f"{found[key]} and {video} would both give tracks called {key}; label them "
                    "into two folders, or rename one"
                )
            found[key] = video
    return found


def given_boxes(video: Path) -> list[Sequence]:
    """The objects in the `.txt` or `.jsonl` file beside a video.

    Raises:
        ValueError: there is none, or it is not well formed.
    """
    beside = [video.with_suffix(suffix) for suffix in (".txt", plain.TRACKS_SUFFIX)]
    for annotation in beside:
        if annotation.is_file():
            return plain.read_clip(video, annotation)
    raise ValueError(
        f"no boxes given for {video}: neither {beside[0].name} nor {beside[1].name} is beside it"
    )


def _videos_below(folder: Path) -> list[Path]:
    videos = (p for p in folder.rglob("*") if p.suffix.lower() in VIDEO_SUFFIXES and p.is_file())
    return sorted(videos, key=lambda path: natural_key(str(path)))
