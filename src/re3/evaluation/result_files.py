"""Result boxes on disk, in the text form benchmarks exchange.

`<folder>/<dataset>/<tracker>/<sequence>.txt` holds `x,y,width,height` a line, 0-based and without
rounding, `nan,nan,nan,nan` where there is no box; `<sequence>.csv` beside it holds the tracker's
score and the seconds it took for each frame.
"""

from __future__ import annotations

import csv
from pathlib import Path, PurePosixPath

import numpy as np

from re3.data.plain import read_boxes
from re3.data.sequence import Sequence
from re3.evaluation.one_pass import Track

_HEADER = ["score", "seconds"]


def result_path(folder: Path, tracker: str, sequence: Sequence) -> Path:
    """Where the boxes of a tracker on a sequence belong.

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
    return folder.joinpath(*parts[:-1], f"{parts[-1]}.txt")


def save_track(path: Path, track: Track) -> None:
    """Write the boxes, scores and times of a track; makes the folders it needs."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # The boxes come last: where they are, the track is complete.
    with path.with_name(f"{path.stem}.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_HEADER)
        writer.writerows(
            [_number(score), _number(seconds)]
            for score, seconds in zip(track.scores, track.seconds, strict=True)
        )
    lines = (",".join(_number(value) for value in box) for box in track.boxes_xywh)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


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
    with times_path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    if len(boxes) != len(sequence) or len(rows) != len(sequence) + 1:
        raise ValueError(
            f"{path} has {len(boxes)} boxes and {times_path.name} {len(rows) - 1} times, but "
            f"sequence {sequence.name!r} has {len(sequence)} frames; delete them or run without "
            "--resume"
        )
    try:
        table = np.array([[float(value) for value in row] for row in rows[1:]])
    except ValueError as error:
        raise ValueError(f"{times_path}: {error}; expected a score and seconds a line") from error
    if rows[0] != _HEADER or table.shape != (len(sequence), 2):
        raise ValueError(f"{times_path} does not have the columns {', '.join(_HEADER)}")
    first = int(np.argmax(sequence.annotated))
    if not np.array_equal(boxes[first], sequence.boxes_xywh[first]):
        raise ValueError(
            f"{path} starts at box {boxes[first].tolist()}, but sequence {sequence.name!r} at "
            f"{sequence.boxes_xywh[first].tolist()}; delete it or run without --resume"
        )
    if np.isnan(boxes[first:]).any():
        return None
    return Track(boxes, table[:, 0], table[:, 1])


def _number(value: float) -> str:
    """The shortest decimal that reads back as the same number."""
    return np.format_float_positional(value, trim="-")
