"""To and from other libraries: OpenCV's rectangles and tracker interface, supervision's detections.

Both ways keep to the conventions of `re3.geometry`: (0, 0) is the top-left corner of the top-left
pixel. OpenCV's rectangle (x, y, w, h) covers the pixels x to x + w - 1: the numbers are the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3 import geometry
from re3.engine import Engine
from re3.models import DEFAULT_MODEL
from re3.result import Result, Status
from re3.tracker import Tracker, TrackerOptions

if TYPE_CHECKING:
    import supervision

Rect = tuple[int, int, int, int]
"""A rectangle of OpenCV: left, top, width, height in whole pixels."""

Box = tuple[float, float, float, float]


def to_rect(box: Result | ArrayLike) -> Rect:
    """The rectangle of whole pixels next to a box, for `cv2.rectangle` and the like.

    Left, right, top and bottom are rounded each by itself, so that neighbouring boxes stay
    neighbours.

    Args:
        box: a result, or x, y, width, height in pixels, finite.

    Returns:
        Python ints; width and height at least 1. May reach outside the frame, as the box may: cut
        it off before slicing an array with it.

    Raises:
        ValueError: not four finite numbers.
    """
    box_xywh = box.box_xywh if isinstance(box, Result) else box
    corners = geometry.convert(box_xywh, "xywh", "xyxy")
    if corners.shape != (4,) or not np.isfinite(corners).all():
        raise ValueError(
            f"box {box_xywh!r} is not four finite numbers; expected x, y, width, height"
        )
    left, top, right, bottom = (round(float(value)) for value in corners)
    return left, top, max(right - left, 1), max(bottom - top, 1)


def from_rect(rect: ArrayLike) -> Box:
    """A rectangle of OpenCV as the box that `Tracker.init` takes.

    Args:
        rect: x, y, width, height, as `cv2.selectROI`, `cv2.boundingRect` or a tracker give it.

    Raises:
        ValueError: not four numbers, or without area, as `cv2.selectROI` returns when cancelled.
    """
    values = np.asarray(rect, dtype=np.float64)
    if values.shape != (4,):
        raise ValueError(
            f"rectangle has shape {values.shape}; expected four numbers x, y, width, height"
        )
    x, y, w, h = (float(value) for value in values)
    if not (w > 0 and h > 0):
        raise ValueError(
            f"rectangle {(x, y, w, h)} has no area; cv2.selectROI returns zeros when it was "
            "cancelled, so ask for the box again"
        )
    return x, y, w, h


class TrackerRe3:
    """A `Tracker` with the interface of OpenCV's trackers.

    Code written for `cv2.TrackerCSRT` changes one line. As there, `init` returns None, `update` a
    bool and four ints, and an object that was not found in one frame may be in a later one. Unlike
    there, boxes of floats are taken too, and errors are ValueError and RuntimeError that say what
    is wrong, not `cv2.error`.

    Args:
        model, engine, options: as of `re3.MultiTracker`.

    Examples:
        >>> tracker = re3.TrackerRe3.create()  # was: cv2.TrackerCSRT.create()
        >>> tracker.init(frame, (368, 58, 158, 374))
        >>> found, box = tracker.update(next_frame)
    """

    def __init__(
        self,
        model: str = DEFAULT_MODEL,
        engine: str | Engine = "auto",
        **options: Unpack[TrackerOptions],
    ) -> None:
        self._tracker = Tracker(model, engine, **options)
        self._score = 0.0

    @classmethod
    def create(cls, *arguments: Any, **options: Any) -> TrackerRe3:
        """A new tracker, as OpenCV's are made; takes what the class takes."""
        return cls(*arguments, **options)

    def init(self, image: NDArray[np.uint8], boundingBox: ArrayLike) -> None:
        """Start to track; the names of the arguments are OpenCV's.

        Args:
            image: uint8 `[H, W, 3]` BGR.
            boundingBox: x, y, width, height in pixels.

        Raises:
            ValueError: an unusable frame or box.
        """
        self._score = self._tracker.init(image, boundingBox).score

    def update(self, image: NDArray[np.uint8]) -> tuple[bool, Rect]:
        """Find the object in the next frame.

        Returns:
            True and the box in whole pixels; False and (0, 0, 0, 0) where the result is `LOST`.

        Raises:
            RuntimeError: called before `init`.
            ValueError: an unusable frame.
        """
        result = self._tracker.update(image)
        self._score = result.score
        if result.status is Status.LOST:
            return False, (0, 0, 0, 0)
        return True, to_rect(result)

    def getTrackingScore(self) -> float:
        """The score of the latest result, 0..1, as `cv2.TrackerNano` has it; 0 before `init`."""
        return self._score


def to_detections(results: Iterable[Result]) -> supervision.Detections:
    """Results of one frame as supervision's detections, for its annotators, zones and sinks.

    The box becomes `xyxy`, the score `confidence`, the object's id `tracker_id`, its name or id
    `data["class_name"]`, which supervision's labels show. `data` also holds `status` (text) and
    `frame_index`. A tracker knows no classes: `class_id` is 0 for all, because annotators colour by
    it unless told otherwise (`color_lookup=supervision.ColorLookup.TRACK`: a colour an object).

    Args:
        results: such as `multi.update(frame).values()`, or a list with the result of a `Tracker`.

    Raises:
        ImportError: supervision is not installed.
    """
    try:
        import supervision
    except ImportError as error:
        raise ImportError(
            "to_detections needs supervision: pip install 'supervision>=0.31.2' (older ones bring "
            "opencv-python, a second OpenCV)"
        ) from error

    shown = list(results)
    boxes = np.array([result.box_xywh for result in shown], dtype=np.float64).reshape(-1, 4)
    return supervision.Detections(
        xyxy=geometry.convert(boxes, "xywh", "xyxy"),
        confidence=np.array([result.score for result in shown], dtype=np.float64),
        class_id=np.zeros(len(shown), dtype=int),
        tracker_id=np.array([result.object_id for result in shown], dtype=int),
        data={
            "class_name": np.array([result.label for result in shown], dtype=str),
            "status": np.array([str(result.status) for result in shown], dtype=str),
            "frame_index": np.array([result.frame_index for result in shown], dtype=int),
        },
    )


def from_detections(detections: supervision.Detections) -> list[Result]:
    """Supervision's detections as results: those of `to_detections`, or a detector's.

    Returns:
        one result a detection, in order. Without `tracker_id` they are numbered from 1; without
        `confidence` the score is NaN; the name is `data["class_name"]` where it is not just the
        id; without a status in `data` it is `TRACKED`, and without `frame_index` that is 0.

    Raises:
        ValueError: boxes that are not `[N, 4]`.

    Examples:
        A detector's boxes start tracks:

        >>> for found in from_detections(detections):
        ...     multi.add(frame, found.box_xywh, found.name)
    """
    boxes = geometry.convert(detections.xyxy, "xyxy", "xywh")
    count, data = len(boxes), detections.data

    def column(values: Any, otherwise: Iterable[Any]) -> list[Any]:
        return list(otherwise) if values is None else np.asarray(values).tolist()

    ids = column(detections.tracker_id, range(1, count + 1))
    scores = column(detections.confidence, [float("nan")] * count)
    labels = column(data.get("class_name"), [None] * count)
    statuses = column(data.get("status"), [Status.TRACKED] * count)
    frames = column(data.get("frame_index"), [0] * count)
    return [
        Result(
            box_xywh=(x, y, w, h),
            score=score,
            status=Status(status),
            frame_index=frame,
            object_id=identity,
            name=None if label is None or label == str(identity) else str(label),
        )
        for (x, y, w, h), score, status, frame, identity, label in zip(
            boxes.tolist(), scores, statuses, frames, ids, labels, strict=True
        )
    ]
