"""Result boxes that others published, shown beside ours without running anything."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from re3.data.plain import read_boxes
from re3.data.sequence import Sequence
from re3.evaluation.frame_log import FrameLog, Step
from re3.evaluation.one_pass import Track


def published_track(folder: Path, sequence: Sequence) -> Track:
    """The published track of a sequence, without any time.

    Args:
        folder: holds `<sequence>.txt`, or `<dataset>/<sequence>.txt`, with
            `x,y,width,height` a line in pixels of the stored frames, 0-based.
        sequence: whose name says which.

    Returns:
        the track. Where there is no file, or it is not one of this sequence, the track has a
        failure and is not scored.
    """
    log = FrameLog(len(sequence))
    places = [
        folder / f"{sequence.name}.txt",
        folder / sequence.dataset / f"{sequence.name}.txt",
    ]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        return Track.of(log, f"no published boxes: {places[0]} does not exist", unscored=True)
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
    first = int(np.argmax(sequence.annotated))
    log.boxes_xywh[first:] = boxes[first:]
    log.boxes_xywh[first] = sequence.boxes_xywh[first]
    log.steps[first:] = Step.FOLLOWED
    return Track.of(log)
