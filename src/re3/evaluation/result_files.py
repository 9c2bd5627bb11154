"""Result boxes on disk, in the text form benchmarks exchange.

`<folder>/<dataset>/<tracker>/<sequence>.txt` holds `x,y,width,height` a line, 0-based and without
rounding, `nan,nan,nan,nan` where there is no box; `<sequence>.csv` beside it holds the tracker's
score and the seconds it took for each frame, the seconds it took to read it and, of a tracker that
tells of them, the seconds of cutting crops and of the network.

Of a run with restarts, a line of the text is a trajectory's as the VOT toolkit writes them: a box,
or a code, 1 where the tracker was started, 2 where it failed, 0 where it was not asked.

Each file is written under another name first and put in place whole.
"""

from __future__ import annotations

import csv
import os
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from re3.data.plain import read_boxes
from re3.data.sequence import Sequence
from re3.evaluation.frame_log import FrameLog, Step
from re3.evaluation.one_pass import Track
from re3.evaluation.supervised import SupervisedTrack

_HEADER = ["score", "seconds"]
_TIMES = ["decode_seconds", "crop_seconds", "network_seconds"]
_CODES = {Step.SKIPPED: "0", Step.STARTED: "1", Step.FAILED: "2"}
_STEPS = {code: step for step, code in _CODES.items()}


def result_path(folder: Path, tracker: str, sequence: Sequence, repeat: int = 0) -> Path:
    """Where the boxes of a tracker on a sequence belong.

    Args:
        folder: of all results.
        tracker: its name.
        sequence: what it ran on.
        repeat: which repetition, from 0; later ones get `.repeat-2` and so on in their name.

    Raises:
        ValueError: a name cannot be part of a path, or would lead out of the folder.
    """
    dataset = sequence.dataset or "sequences"
    parts = [dataset, tracker, *PurePosixPath(sequence.name).parts]
    if any(part in (".", "..") or "/" in part or "\\" in part or not part for part in parts):
        raise ValueError(
            f"dataset {dataset!r}, tracker {tracker!r} and sequence {sequence.name!r} do not make "
            f"a path inside {folder}; expected plain names (give a tracker one as NAME=MODEL.onnx)"
        )
    suffix = f".repeat-{repeat + 1}" if repeat else ""
    return folder.joinpath(*parts[:-1], f"{parts[-1]}{suffix}.txt")


def save_track(path: Path, track: Track) -> None:
    """Write the boxes, scores and times of a track; makes the folders it needs."""
    # The boxes come last: where they are, the track is complete.
    _save_times(path, track.scores, track)
    write_whole(path, "".join(f"{_box_line(box)}\n" for box in track.boxes_xywh))


def save_supervised(path: Path, track: SupervisedTrack) -> None:
    """Write a track with restarts; makes the folders it needs."""
    scores = np.full(len(track.steps), np.nan) if track.scores is None else track.scores
    _save_times(path, scores, track)
    lines = (
        _CODES.get(Step(step)) or _box_line(box)
        for step, box in zip(track.steps, track.boxes_xywh, strict=True)
    )
    write_whole(path, "".join(f"{line}\n" for line in lines))


def write_whole(path: Path, text: str) -> None:
    """Write a text file such that it is there complete or not at all; makes its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = partial_path(path)
    try:
        with partial.open("w", encoding="utf-8", newline="") as file:
            file.write(text)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def partial_path(path: Path, kind: str = "partial") -> Path:
    """Where this process keeps what is not complete yet: a hidden file beside the final one."""
    return path.with_name(f".{path.name}.{os.getpid()}.{kind}")


def load_track(path: Path, sequence: Sequence) -> Track | None:
    """Read a track back.

    Returns:
        the track, or None where it is not there or not complete: a tracker that failed, a run
        that was interrupted.

    Raises:
        ValueError: the files are not well formed, or are those of another clip.
    """
    times_path = path.with_name(f"{path.stem}.csv")
    if not path.is_file() or not times_path.is_file():
        return None
    boxes = read_boxes(path)
    log = FrameLog(len(sequence))
    _load_times(path, sequence, len(boxes), log)
    first = int(np.argmax(sequence.annotated))
    if not np.array_equal(boxes[first], sequence.start_xywh, equal_nan=True):
        raise ValueError(
            f"{path} starts at box {boxes[first].tolist()}, but sequence {sequence.name!r} at "
            f"{sequence.start_xywh.tolist()}; delete it or run without --resume"
        )
    if np.isnan(boxes[first:]).any():
        return None
    log.boxes_xywh = boxes
    return Track.of(log)


def load_supervised(path: Path, sequence: Sequence) -> SupervisedTrack | None:
    """Read a track with restarts back.

    Returns:
        the track, or None where it is not there.

    Raises:
        ValueError: the files are not well formed, or are those of another clip.
    """
    if not path.is_file() or not path.with_name(f"{path.stem}.csv").is_file():
        return None
    lines = path.read_text(encoding="utf-8").splitlines()
    log = FrameLog(len(sequence))
    _load_times(path, sequence, len(lines), log)
    for index, line in enumerate(lines):
        log.steps[index] = _STEPS.get(line.strip(), Step.FOLLOWED)
        if log.steps[index] == Step.FOLLOWED:
            try:
                x, y, width, height = (float(field) for field in line.split(","))
            except ValueError:
                raise ValueError(
                    f"{path}, line {index + 1}: {line!r} is neither x,y,width,height nor one of "
                    "the codes 0, 1, 2; delete it or run without --resume"
                ) from None
            log.boxes_xywh[index] = x, y, width, height
    started = log.steps == Step.STARTED
    first = int(np.argmax(sequence.annotated))
    if not started[first] or not sequence.annotated[started].all():
        raise ValueError(
            f"{path} is not started where sequence {sequence.name!r} begins, frame {first}, or in "
            "a frame without truth; delete it or run without --resume"
        )
    log.boxes_xywh[started] = sequence.boxes_xywh[started]
    return SupervisedTrack.of(log)


def _save_times(path: Path, scores: NDArray[np.float64], track: Track | SupervisedTrack) -> None:
    header, columns = list(_HEADER), [scores, track.seconds]
    parts = (track.crop_seconds, track.network_seconds)
    times = [track.decode_seconds]
    # A column for the trackers that tell, and files as they were for the others.
    times += [part if part is not None and np.isfinite(part).any() else None for part in parts]
    for name, column in zip(_TIMES, times, strict=True):
        if column is not None:
            header.append(name)
            columns.append(column)
    rows = [",".join(_number(value) for value in row) for row in zip(*columns, strict=True)]
    write_whole(
        path.with_name(f"{path.stem}.csv"), "".join(f"{r}\n" for r in [",".join(header), *rows])
    )


def _load_times(path: Path, sequence: Sequence, lines: int, log: FrameLog) -> None:
    times_path = path.with_name(f"{path.stem}.csv")
    with times_path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    if lines != len(sequence) or len(rows) != len(sequence) + 1:
        raise ValueError(
            f"{path} has {lines} boxes and {times_path.name} {len(rows) - 1} times, but "
            f"sequence {sequence.name!r} has {len(sequence)} frames; delete them or run without "
            "--resume"
        )
    try:
        table = np.array([[float(value) for value in row] for row in rows[1:]])
    except ValueError as error:
        raise ValueError(f"{times_path}: {error}; expected a score and seconds a line") from error
    # Earlier versions did not measure the decoding, and later ones not its parts.
    names = rows[0][len(_HEADER) :]
    known = rows[0][: len(_HEADER)] == _HEADER and names == [n for n in _TIMES if n in names]
    if not known or table.shape != (len(sequence), len(rows[0])):
        raise ValueError(
            f"{times_path} does not have the columns {', '.join(_HEADER)} and, where they were "
            f"measured, {', '.join(_TIMES)}"
        )
    log.scores, log.seconds = table[:, 0], table[:, 1]
    for name, column in zip(names, table[:, len(_HEADER) :].T, strict=True):
        setattr(log, name, column)


def _box_line(box: NDArray[np.float64]) -> str:
    return ",".join(_number(value) for value in box)


def _number(value: float) -> str:
    """The shortest decimal that reads back as the same number."""
    return np.format_float_positional(value, trim="-")
