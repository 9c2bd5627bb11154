"""Result boxes that others published, shown beside ours without running anything."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from re3.data.plain import read_boxes
from re3.data.sequence import Sequence
from re3.evaluation.frame_log import FrameLog, Step
from re3.evaluation.one_pass import Track


def published_track(folder: Path, sequence: Sequence, first_pixel: int = 0) -> Track:
    """The published track of a sequence, without any time.

    Args:
        folder: holds `<sequence>.txt`, or `<dataset>/<sequence>.txt`, with
            `x,y,width,height` a line in pixels of the stored frames.
        sequence: whose name says which.
        first_pixel: what the boxes call the first column and row of an image: 0, or 1 as most
            published for OTB do.

    Returns:
        the track. Where there is no file, or it is not one of this sequence, the track has a
        failure and is not scored.
    """
    log = FrameLog(len(sequence))
    path = _path_of(folder, sequence)
    if path is None:
        missing = folder / f"{sequence.name}.txt"
        return Track.of(log, f"no published boxes: {missing} does not exist", unscored=True)
    try:
        boxes = read_boxes(path)
    except (ValueError, OSError) as error:
        return Track.of(log, f"the published boxes cannot be read: {error}", unscored=True)
    if len(boxes) != len(sequence) or not sequence.annotated.any():
        told = (
            f"{path} has {len(boxes)} boxes for {len(sequence)} frames, "
            f"{int(sequence.annotated.sum())} of them annotated; is it another clip's?"
        )
        return Track.of(log, told, unscored=True)
    boxes[:, :2] -= first_pixel
    first = int(np.argmax(sequence.annotated))
    log.boxes_xywh[first:] = boxes[first:]
    log.boxes_xywh[first] = sequence.boxes_xywh[first]
    log.steps[first:] = Step.FOLLOWED
    return Track.of(log)


def looks_shifted(folder: Path, sequences: Iterable[Sequence], first_pixel: int = 0) -> bool:
    """Whether published boxes seem to count pixels from another number than they are read with.

    They begin with the box that the tracker was given, which is the truth: where most of them
    begin one pixel beside it, across and down, they were read wrongly.

    Args:
        folder, first_pixel: as of `published_track`.
        sequences: that they are of.
    """
    shift = 1 if first_pixel == 0 else -1
    told = shifted = 0
    for sequence in sequences:
        path = _path_of(folder, sequence)
        if path is None or not sequence.annotated.any():
            continue
        try:
            boxes = read_boxes(path)
        except (ValueError, OSError):
            continue
        first = int(np.argmax(sequence.annotated))
        if len(boxes) > first:
            offset = boxes[first] - (first_pixel, first_pixel, 0, 0) - sequence.start_xywh
            told += 1
            shifted += bool(np.allclose(offset, (shift, shift, 0, 0), atol=0.01))
    return shifted > told / 2


def _path_of(folder: Path, sequence: Sequence) -> Path | None:
    """The file of boxes of a sequence; None without one."""
    name = f"{sequence.name}.txt"
    places = (folder / name, folder / sequence.dataset / name)
    return next((place for place in places if place.is_file()), None)
