"""A picture as a dataset annotates it, before objects that are too small are left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from re3.data.masks import IndexedMask, Mask, MaskImage
from re3.data.picture_size import check_size, picture_size
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

    def with_fitting_masks(self, size: tuple[int, int]) -> Picture:
        """The picture without those outlines that are images of another size; notes say which.

        Args:
            size: width and height of the decoded picture.

        Raises:
            FileNotFoundError, ValueError: the image of an outline is missing or cannot be read.
        """
        paths = dict.fromkeys(m.path for m in self.masks if isinstance(m, MaskImage | IndexedMask))
        found = {path: picture_size(path) for path in paths}
        wrong = {path: each for path, each in found.items() if each != size}
        if not wrong:
            return self
        notes = [
            f"{path} is {width} x {height} pixels, but {self.image} {size[0]} x {size[1]}: no "
            "outline; the boxes are used"
            for path, (width, height) in wrong.items()
        ]
        masks = [
            None if isinstance(mask, MaskImage | IndexedMask) and mask.path in wrong else mask
            for mask in self.masks
        ]
        return replace(self, masks=tuple(masks), notes=(*self.notes, *notes))

    def still(self, smallest_share: float) -> Still | None:
        """The picture with those of its objects that are large enough; None without any.

        Raises:
            As `checked_size` and `with_fitting_masks`.
        """
        if not len(self.boxes_xywh):
            return None
        fitting, area = self, 1.0
        if not self.relative:
            width, height = self.checked_size()
            fitting, area = self.with_fitting_masks((width, height)), float(width * height)
        return make_still(
            self.image,
            self.boxes_xywh,
            area,
            smallest_share,
            masks=list(fitting.masks),
            relative=self.relative,
            dataset=self.dataset,
            notes=fitting.notes,
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
