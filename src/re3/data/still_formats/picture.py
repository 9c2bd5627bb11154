"""A picture as a dataset annotates it, before objects that are too small are left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from re3.data.masks import Mask
from re3.data.picture_size import check_size
from re3.data.stills import Still, make_still
from re3.geometry import Floats


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture with all of its objects.

    Attributes:
        image: path of the picture.
        boxes_xywh: float64 `[N, 4]` in pixels, or in shares of the picture if `relative`. Boxes
            without an area may be among them.
        masks: one a box, None where the box is all that is known.
        size: width and height in pixels for which the boxes were made, as the annotation states
            them; None where it does not.
        stated_in: the file that states the size, for messages.
        relative: boxes are shares of the picture's width and height.
        dataset: name of the dataset.
        notes: what was put right in the annotation, a sentence each; they name the annotation.
    """

    image: Path
    boxes_xywh: Floats
    masks: tuple[Mask | None, ...]
    size: tuple[float, float] | None = None
    stated_in: Path | None = None
    relative: bool = False
    dataset: str = ""
    notes: tuple[str, ...] = ()

    def checked_size(self) -> tuple[int, int]:
        """Width and height of the decoded picture, compared with the stated ones.

        Raises:
            FileNotFoundError: there is no such file.
            WrongSize: the annotation states another size.
            ValueError: the picture cannot be read.
        """
        return check_size(self.image, self.size, self.stated_in or self.image)

    def still(self, smallest_share: float) -> Still | None:
        """The picture with those of its objects that are large enough; None without any.

        Raises:
            As `checked_size`.
        """
        if not len(self.boxes_xywh):
            return None
        area = 1.0
        if not self.relative:
            width, height = self.checked_size()
            area = float(width * height)
        return make_still(
            self.image,
            self.boxes_xywh,
            area,
            smallest_share,
            masks=list(self.masks),
            relative=self.relative,
            dataset=self.dataset,
            notes=self.notes,
        )


@dataclass(frozen=True)
class PictureEntry:
    """One picture of a dataset, found but not read yet.

    Attributes:
        name: of the picture, for people.
        read: reads its annotation; raises ValueError or OSError, with a message that names the
            file and the annotation, where that is broken.
    """

    name: str
    read: Callable[[], Picture]


def boxes_array(boxes: object) -> Floats:
    """Boxes as float64 `[N, 4]`, also without any."""
    return np.asarray(boxes, dtype=np.float64).reshape(-1, 4)
