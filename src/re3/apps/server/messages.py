"""What is told of a video: its objects, what was found in a frame, and the picture of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import islice

import cv2

from re3.apps.server.tracked_video import TrackedVideo
from re3.apps.server.wire import Head
from re3.result import Result
from re3.video import Frame

SHOWN_SIDE = 1280
"""Longer side in pixels of the pictures sent to the page; boxes are in pixels of the video."""

JPEG_QUALITY = 85

BOXES_A_MESSAGE = 500
"""Frames whose boxes go into one message to a page."""


def video_message(video: TrackedVideo) -> Head:
    """The part of a session's state that is about its video."""
    height, width = video.frame.image.shape[:2]
    objects = [
        {
            "id": each.id,
            "name": each.name,
            "colour": each.colour,
            "first": each.first,
            "given": list(each.given),
            "ends": each.ends,
            "tracked": [list(stretch) for stretch in each.ranges()],
        }
        for each in video.objects.values()
    ]
    undo, redo = video.history.undo_change, video.history.redo_change
    return {
        "width": width,
        "height": height,
        "frame_count": video.frame_count,
        "position": video.position,
        "start": video.start,
        "tracked_until": video.tracked_until,
        "untracked": video.untracked(),
        "catching_up": video.frames_to_catch_up(),
        "undo": undo and undo.what,
        "redo": redo and redo.what,
        "broken": video.broken,
        "objects": objects,
    }


def frame_message(video: TrackedVideo, index: int) -> Head:
    """What is known of a frame; of the one shown also the speed."""
    told: Head = {"type": "frame", "index": index, "timestamp": video.timestamp(index)}
    if index == video.position:
        told["tracking_ms"] = round(video.tracking_ms, 2)
        told["tracking_fps"] = round(video.fps, 1)
    told["results"] = [result_message(result) for result in video.results_at(index)]
    return told


def result_message(result: Result) -> Head:
    """A result as the API says it."""
    return {
        "object": result.object_id,
        "name": result.label,
        "box_xywh": list(result.box_xywh),
        "score": None if math.isnan(result.score) else result.score,
        "status": result.status.value,
    }


def boxes_messages(video: TrackedVideo, indices: Iterable[int]) -> Iterator[Head]:
    """What is known of frames, `BOXES_A_MESSAGE` in one message."""
    remaining = iter(indices)
    while some := list(islice(remaining, BOXES_A_MESSAGE)):
        yield {"type": "boxes", "frames": [frame_message(video, index) for index in some]}


def jpeg(frame: Frame, whole: bool = False) -> bytes:
    """The frame as it is shown, no larger than `SHOWN_SIDE` unless it is to be `whole`."""
    image = frame.image
    height, width = image.shape[:2]
    scale = SHOWN_SIDE / max(height, width)
    if scale < 1 and not whole:
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return bytes(data)
