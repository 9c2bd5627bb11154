"""Still pictures with objects in them: the simulator's raw material."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.data.masks import Mask
from re3.geometry import Floats

SMALLEST_SHARE = 0.01
"""Objects that cover less of the image, 0.1 squared, are discarded (Re3, sec. III-C)."""

LARGEST_PATCH = 0.25
"""Share of the image that a random patch covers at most; with more, little would be left of the
picture to move before."""


@dataclass(frozen=True, eq=False)
class Still:
    """A picture to cut objects from.

    Attributes:
        image: path of the picture.
        boxes_xywh: float64 `[N, 4]` in pixels of the picture; N is 0 where nothing is annotated
            and any patch may be taken for an object.
        masks: one for each box, None where the box is all that is known.
        relative: boxes are shares of the picture's width and height.
        dataset: the name of the dataset, that of its folder.
        smallest_share: of the image that a random patch covers at least.
        notes: what was put right in its annotation, a sentence each.
    """

    image: Path
    boxes_xywh: Floats
    masks: tuple[Mask | None, ...]
    relative: bool = False
    dataset: str = ""
    smallest_share: float = SMALLEST_SHARE
    notes: tuple[str, ...] = ()

    @property
    def masked(self) -> bool:
        """Whether the outline of every object is known."""
        return bool(self.masks) and all(mask is not None for mask in self.masks)

    def read(self) -> NDArray[np.uint8]:
        """The picture, uint8 `[H, W, 3]` BGR; raises ValueError if it cannot be read."""
        image = cv2.imread(str(self.image), cv2.IMREAD_COLOR)
        if image is None:
            raise ValueError(
                f"{self.image} cannot be read as an image; remove it from the dataset or restore it"
            )
        return np.asarray(image, dtype=np.uint8)

    def draw_object(
        self, width: int, height: int, rng: np.random.Generator
    ) -> tuple[Floats, NDArray[np.uint8] | None]:
        """One of the objects, or a random patch where none is annotated.

        Args:
            width, height: of the picture in pixels.
            rng: source of the choice.

        Returns:
            the box_xywh in pixels, and uint8 `[height, width]`, 255 on the object, or None where
            only the box is known.

        Raises:
            ValueError, OSError: the mask cannot be read; the message names the picture.
        """
        if not len(self.boxes_xywh):
            return self._patch(width, height, rng), None
        index = int(rng.integers(len(self.boxes_xywh)))
        size = (width, height, width, height)
        box = self.boxes_xywh[index] * size if self.relative else self.boxes_xywh[index]
        mask = self.masks[index]
        if mask is None:
            return box, None
        try:
            return box, mask.read(width, height)
        except ValueError as error:
            raise ValueError(f"{self.image}: {error}") from error

    def _patch(self, width: int, height: int, rng: np.random.Generator) -> Floats:
        largest = max(LARGEST_PATCH, self.smallest_share)
        share = np.exp(rng.uniform(*np.log([max(self.smallest_share, 1e-4), largest])))
        stretch = np.exp(0.5 * np.clip(rng.normal(0.0, 0.4), -1.0, 1.0))
        side = np.sqrt(share * width * height)
        size = np.minimum([side * stretch, side / stretch], [width, height])
        return np.concatenate([rng.uniform(0, 1, 2) * ((width, height) - size), size])


def make_still(
    image: Path,
    boxes_xywh: ArrayLike,
    area: float,
    smallest_share: float,
    *,
    masks: list[Mask | None] | None = None,
    relative: bool = False,
    dataset: str = "",
    notes: tuple[str, ...] = (),
) -> Still | None:
    """A picture with those of its objects that are large enough; None without any.

    Args:
        image: path of the picture.
        boxes_xywh: `[N, 4]` in pixels, or shares of the picture if `relative`.
        area: of the picture in the same units.
        smallest_share: of the picture; objects that cover less are left out, and so are boxes
            without an area.
        masks: one for each box; by default there are none.
        relative, dataset, notes: see `Still`.
    """
    boxes = np.asarray(boxes_xywh, dtype=np.float64).reshape(-1, 4)
    kept = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] > 0).all(axis=1)
    kept &= boxes[:, 2] * boxes[:, 3] >= smallest_share * area
    if not kept.any():
        return None
    all_masks = masks if masks is not None else [None] * len(boxes)
    chosen = tuple(mask for mask, keep in zip(all_masks, kept, strict=True) if keep)
    return Still(image, boxes[kept], chosen, relative, dataset, smallest_share, notes)
