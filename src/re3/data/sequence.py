"""One tracked object in one clip: where the frames are and where the object is in each of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from re3.video import open_source

TINY_SIDE = 4.0
"""Pixels below which a side of a box counts as tiny: hardly anything to recognise."""
JUMP_IN_AREA = 4.0
"""Change of a box's area within one frame, up or down, above which it counts as a jump."""


# Without eq=False the generated __eq__ would compare arrays and fail on their truth value.
@dataclass(frozen=True, eq=False)
class Sequence:
    """An annotated track; readers of every dataset format return these.

    Attributes:
        name: the clip's name, e.g. `blackswan`; of a clip with several tracks the clip's name, a
            slash and the object's id, e.g. `ADL-Rundle-6/3`.
        source: a video file or a folder of images.
        boxes_xywh: float64 `[T, 4]`, left, top, width, height in pixels of the stored frames,
            0-based; a row of NaN where the object is absent or not annotated. Row t belongs to
            frame `start_frame + t` of the source. Made read-only.
        label: what the object is, e.g. `person`, where the annotation says so.
        dataset: the name of the dataset, by default that of the folder the clip lies in.
        start_frame: index in the source of the first frame of the track.
        occluded: `[T]`, True where the dataset marks the object as occluded, in part or wholly;
            None where it marks nothing.
        attributes: what the dataset says makes the sequence hard, e.g. `("fast motion",)`.
        polygons: T of them, `[P, 2]` each, x and y in pixels, P of 3 or more: the object's corners
            where the dataset gives them in place of an upright box; `boxes_xywh` has the outermost
            upright box. None for a frame without, or where there is none at all. Made read-only.
        row_a_frame: the annotation is of a form that has a row for every frame of the source, so
            that fewer rows than frames are a sign of a mistake.

    Raises:
        ValueError: the boxes are not `[T, 4]` with T above 0, a row is neither NaN throughout nor
            a finite box with an area, `start_frame` is negative, `occluded` is not `[T]`, or the
            polygons are not T, or one is not a finite `[P, 2]` of a frame with a box.
    """

    name: str
    source: Path
    boxes_xywh: NDArray[np.float64]
    label: str | None = None
    dataset: str = ""
    start_frame: int = 0
    occluded: NDArray[np.bool_] | None = None
    attributes: tuple[str, ...] = ()
    polygons: tuple[NDArray[np.float64] | None, ...] | None = None
    row_a_frame: bool = False

    def __post_init__(self) -> None:
        boxes = np.array(self.boxes_xywh, dtype=np.float64)
        if boxes.ndim != 2 or boxes.shape[1] != 4 or len(boxes) == 0:
            raise ValueError(
                f"sequence {self.name!r}: boxes have shape {boxes.shape}; expected [T, 4], T > 0"
            )
        if self.start_frame < 0:
            raise ValueError(
                f"sequence {self.name!r}: start_frame is {self.start_frame}; expected 0 or more"
            )
        absent = np.isnan(boxes).all(axis=1)
        usable = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] > 0).all(axis=1)
        if not (absent | usable).all():
            row = int(np.argmin(absent | usable))
            raise ValueError(
                f"sequence {self.name!r}: box {boxes[row].tolist()} in row {row} is neither a "
                "finite x, y, width, height with an area nor NaN throughout"
            )
        if self.occluded is not None:
            occluded = np.array(self.occluded, dtype=bool)
            if occluded.shape != (len(boxes),):
                raise ValueError(
                    f"sequence {self.name!r}: {occluded.shape} marks of occlusion for "
                    f"{len(boxes)} boxes; expected one a box"
                )
            occluded.flags.writeable = False
            object.__setattr__(self, "occluded", occluded)
        if self.polygons is not None:
            object.__setattr__(self, "polygons", self._checked_polygons(self.polygons, boxes))
        boxes.flags.writeable = False
        object.__setattr__(self, "boxes_xywh", boxes)

    def _checked_polygons(
        self, given: tuple[NDArray[np.float64] | None, ...], boxes: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64] | None, ...] | None:
        """Read-only copies; None where there is no polygon at all."""
        if len(given) != len(boxes):
            raise ValueError(
                f"sequence {self.name!r}: {len(given)} polygons for {len(boxes)} boxes; expected "
                "one a box, None where there is no polygon"
            )
        polygons: list[NDArray[np.float64] | None] = []
        for row, points in enumerate(given):
            polygon = None if points is None else np.array(points, dtype=np.float64)
            if polygon is not None:
                usable = polygon.ndim == 2 and polygon.shape[1:] == (2,) and len(polygon) >= 3
                if not usable or not np.isfinite(polygon).all() or np.isnan(boxes[row, 0]):
                    raise ValueError(
                        f"sequence {self.name!r}: the polygon in row {row} has shape "
                        f"{polygon.shape}; expected finite points [P, 2], P of 3 or more, in a "
                        "frame with a box"
                    )
                polygon.flags.writeable = False
            polygons.append(polygon)
        return None if all(polygon is None for polygon in polygons) else tuple(polygons)

    def __len__(self) -> int:
        """Number of frames, T."""
        return len(self.boxes_xywh)

    @property
    def annotated(self) -> NDArray[np.bool_]:
        """`[T]`, True where the object has a box."""
        return ~np.isnan(self.boxes_xywh[:, 0])

    @property
    def start_xywh(self) -> NDArray[np.float64]:
        """`[4]`, the box that a tracker is given: the truth in the first annotated frame."""
        return self.boxes_xywh[int(np.argmax(self.annotated))]

    def problems(self, frame_size: tuple[int, int] | None = None) -> list[str]:
        """What looks wrong with the boxes, in short sentences for a person to check.

        Real tracks have such frames too: an object may be small, or leap after a cut.

        Args:
            frame_size: width and height in pixels; None leaves out what lies outside.

        Returns:
            one each for boxes wholly outside the frame, boxes with a side below `TINY_SIDE`
            pixels, and jumps: from one frame to the next the centre moves further than the
            longer of the two boxes' diagonals, or the area changes more than `JUMP_IN_AREA`
            times. Frames are counted from 0 in the source.
        """
        low, size = self.boxes_xywh[:, :2], self.boxes_xywh[:, 2:]
        tiny = (size < TINY_SIDE).any(axis=1)
        centre, diagonal, area = low + size / 2, np.hypot(*size.T), size.prod(axis=1)
        moved = np.hypot(*np.diff(centre, axis=0).T)
        far = moved > np.maximum(diagonal[1:], diagonal[:-1])
        grown = np.maximum(area[1:] / area[:-1], area[:-1] / area[1:]) > JUMP_IN_AREA
        found = {f"side below {TINY_SIDE:g} px": tiny, "jump": np.append(False, far | grown)}
        if frame_size is not None:
            outside = (low >= frame_size).any(axis=1) | (low + size <= 0).any(axis=1)
            found = {"outside the frame": outside, **found}
        return [
            f"{what} in {int(frames.sum())} of {len(self)} frames, first in frame "
            f"{self.start_frame + int(np.argmax(frames))}"
            for what, frames in found.items()
            if frames.any()
        ]

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """The T frames of the track in order, uint8 `[H, W, 3]` BGR.

        Raises:
            ValueError: the source cannot be read (`re3.video.SourceError`) or ends before the
                boxes do.
        """
        given = 0
        with open_source(self.source, start_frame=self.start_frame, skip_broken=False) as frames:
            for given, frame in enumerate(frames, start=1):
                yield frame.image
                if given == len(self):
                    return
        raise ValueError(
            f"{self.source} gives {given} frames from frame {self.start_frame} on, but sequence "
            f"{self.name!r} has {len(self)} boxes; expected one frame a box: "
            "is the annotation that of another clip?"
        )
