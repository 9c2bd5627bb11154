"""One tracked object in one clip: where the frames are and where the object is in each of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from re3.video import open_source


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

    Raises:
        ValueError: the boxes are not `[T, 4]` with T above 0, a row is neither NaN throughout nor
            a finite box with an area, or `start_frame` is negative.
    """

    name: str
    source: Path
    boxes_xywh: NDArray[np.float64]
    label: str | None = None
    dataset: str = ""
    start_frame: int = 0

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
        boxes.flags.writeable = False
        object.__setattr__(self, "boxes_xywh", boxes)

    def __len__(self) -> int:
        """Number of frames, T."""
        return len(self.boxes_xywh)

    @property
    def annotated(self) -> NDArray[np.bool_]:
        """`[T]`, True where the object has a box."""
        return ~np.isnan(self.boxes_xywh[:, 0])

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """The T frames of the track in order, uint8 `[H, W, 3]` BGR.

        Raises:
            ValueError: the source cannot be read (`re3.video.SourceError`) or ends before the
                boxes do.
        """
        given = 0
        with open_source(self.source, start_frame=self.start_frame) as frames:
            for given, frame in enumerate(frames, start=1):
                yield frame.image
                if given == len(self):
                    return
        raise ValueError(
            f"{self.source} gives {given} frames from frame {self.start_frame} on, but sequence "
            f"{self.name!r} has {len(self)} boxes; expected one frame a box: "
            "is the annotation that of another clip?"
        )
