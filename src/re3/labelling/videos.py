"""The tracks of a shot: where to start, what to keep."""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence
from re3.evaluation.metrics import overlap
from re3.labelling.agreement import Agreement, Pair, follow, kept_boxes, settled, stretches
from re3.labelling.config import LabelConfig
from re3.labelling.regions import Motion, Region, salient_regions
from re3.labelling.shots import Shot, ShotReader

Floats = NDArray[np.float64]

LEAST_FOREGROUND = 0.4
"""Part of a box that is foreground at least, where the camera stands still."""
LEAST_OWN_MOTION = 0.5
"""Pixels of a thumbnail that an object moves relative to a moving camera in three frames."""
KNOWN = 0.4
"""Overlap (IoU) from which a region shows an object that is already followed."""


# Without eq=False the generated __eq__ would compare arrays and fail on their truth value.
@dataclass(frozen=True, eq=False)
class LabelledTrack:
    """An object in consecutive frames of a shot.

    Attributes:
        frames: uint8 `[H, W, 3]` BGR, T of them.
        boxes_xywh: `[T, 4]`, pixels of these frames, interpolated where the trackers do not agree.
        first_frame: index of the first in the video.
        agreement: mean overlap of the other frames, 0..1.
    """

    frames: Several[NDArray[np.uint8]]
    boxes_xywh: Floats
    first_frame: int
    agreement: float


def label_shot(shot: Shot, pair: Pair, config: LabelConfig) -> list[LabelledTrack]:
    """Find objects in a shot and follow them.

    Args:
        shot: frames without a cut.
        pair: the trackers.
        config: what is kept.

    Returns:
        the tracks, one or more for each object; frames in which less than `LEAST_FOREGROUND` of
        the box is foreground count as not agreed.
    """
    motion = Motion(shot.frames)
    moving = _moving(shot, motion)
    middle = len(shot.frames) // 2
    followed: list[Floats] = []
    tracks: list[LabelledTrack] = []
    for region in moving or salient_regions(shot.frames[middle], middle):
        if len(followed) >= config.objects:
            break
        if _known(region, followed):
            continue
        box = settled(pair, shot.frames[region.frame], region.box_xywh)
        if box is None:
            continue
        found = follow(pair, shot.frames, region.frame, box)
        followed.append(found.boxes_xywh)
        kept = kept_tracks(shot, _in_foreground(found, motion), config)
        tracks += [
            track
            for track in kept
            if travelled(track.boxes_xywh) >= config.least_motion
            and (not moving or _moves_alone(found, motion))
        ]
    return tracks


def label_given(
    shot: Shot, given: Several[Region], pair: Pair, config: LabelConfig
) -> list[LabelledTrack]:
    """Follow objects from given boxes, those that do not move as well.

    Args:
        shot: frames without a cut.
        given: boxes in pixels of the shot's frames, frames by index in the shot.
        pair: the trackers.
        config: what is kept.
    """
    return [
        track
        for region in given
        for track in kept_tracks(
            shot, follow(pair, shot.frames, region.frame, region.box_xywh), config
        )
    ]


def label_video(
    video: Path, pair: Pair, config: LabelConfig, given: Several[Sequence] | None = None
) -> tuple[list[LabelledTrack], Fraction]:
    """The tracks of a whole video.

    Args:
        video: its file.
        pair: the trackers.
        config: what is kept.
        given: objects with boxes to start from: in each shot each starts from its first box in a
            frame that is used. None looks for regions.

    Returns:
        the tracks, and their frames a second.

    Raises:
        SourceError: it cannot be read.
    """
    phase = ShotReader(video, config)
    starts = [s.start_frame + int(np.argmax(s.annotated)) for s in given or []]
    # The first box given lies in a frame that is used.
    reader = ShotReader(video, config, min(starts) % phase.step) if starts else phase
    tracks: list[LabelledTrack] = []
    for shot in reader.shots():
        if given is None:
            tracks += label_shot(shot, pair, config)
        else:
            tracks += label_given(shot, _first_boxes(shot, given), pair, config)
    return tracks, reader.fps


def kept_tracks(shot: Shot, found: Agreement, config: LabelConfig) -> list[LabelledTrack]:
    """The stretches of one object that are long, and boxes large, enough."""
    tracks = []
    for part in stretches(found.overlaps, config.threshold, config.shortest, config.gap):
        agreed = found.overlaps[part] >= config.threshold
        boxes = kept_boxes(found, part, config.threshold)
        if boxes[:, 2:].min() >= config.least_side:
            first = int(shot.indices[part.start])
            agreement = float(found.overlaps[part][agreed].mean())
            tracks.append(LabelledTrack(shot.frames[part], boxes, first, agreement))
    return tracks


def travelled(boxes_xywh: Floats) -> float:
    """Diagonal of the area that a box's centre covers, in units of the box's median size.

    Args:
        boxes_xywh: `[T, 4]`.
    """
    centres = boxes_xywh[:, :2] + boxes_xywh[:, 2:] / 2
    size = float(np.sqrt(np.median(boxes_xywh[:, 2:].prod(axis=1))))
    return float(np.hypot(*np.ptp(centres, axis=0))) / size


def _first_boxes(shot: Shot, given: Several[Sequence]) -> list[Region]:
    """The first box of each object in a shot, if any."""
    regions = []
    for sequence in given:
        rows = shot.indices - sequence.start_frame
        inside = np.flatnonzero((rows >= 0) & (rows < len(sequence)))
        boxes = sequence.boxes_xywh[rows[inside]] * shot.scale
        annotated = np.flatnonzero(~np.isnan(boxes[:, 0]))
        if len(annotated):
            first = int(annotated[0])
            regions.append(Region(int(inside[first]), boxes[first], 1.0))
    return regions


def _moving(shot: Shot, motion: Motion) -> list[Region]:
    """Moving regions a sixth, half and five sixths of the way through the shot."""
    count = len(shot.frames)
    frames = sorted({count // 6, count // 2, 5 * count // 6})
    return sorted(
        (region for frame in frames for region in motion.regions(frame)),
        key=lambda region: -region.strength,
    )


def _in_foreground(found: Agreement, motion: Motion) -> Agreement:
    overlaps = found.overlaps.copy()
    for index in np.flatnonzero(overlaps).tolist():
        if motion.foreground_share(index, found.boxes_xywh[index]) < LEAST_FOREGROUND:
            overlaps[index] = 0.0
    return Agreement(found.boxes_xywh, overlaps)


def _moves_alone(found: Agreement, motion: Motion) -> bool:
    """Whether an object moves relative to the camera, over its whole track."""
    return motion.foreground is not None or motion.own(found.boxes_xywh) >= LEAST_OWN_MOTION


def _known(region: Region, followed: list[Floats]) -> bool:
    return any(
        overlap(boxes[region.frame][None], region.box_xywh[None])[0] >= KNOWN for boxes in followed
    )
