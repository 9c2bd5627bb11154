"""A simulated clip: layers on affine paths, rendered where they are looked at.

Coordinates of pictures and scenes are at pixel corners, as everywhere in re3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3 import geometry
from re3.data.stills import Still
from re3.geometry import Floats


@dataclass(frozen=True, eq=False)
class Look:
    """What a layer looks like in a frame.

    Attributes:
        image: uint8 `[h, w, 3]` BGR.
        alpha: uint8 `[h, w]`, or None for the background, which is reflected at its borders.
        hull: float64 `[N, 2]`, convex hull of the opaque part in the picture.
    """

    image: NDArray[np.uint8]
    alpha: NDArray[np.uint8] | None
    hull: Floats

    @classmethod
    def cut_out(cls, image: NDArray[np.uint8], alpha: NDArray[np.uint8]) -> Look:
        """A picture of which the opaque part is shown."""
        return cls(image, alpha, _hull(alpha))

    @classmethod
    def background(cls, image: NDArray[np.uint8]) -> Look:
        """A picture that is seen everywhere."""
        return cls(image, None, _corners(image))


@dataclass(frozen=True, eq=False)
class Layer:
    """A picture on an affine path.

    Attributes:
        looks: one for all frames, or one a frame, all of the same size.
        paths: float64 `[T, 2, 3]`, picture to scene, in pixel-corner coordinates.
        shown: `[T]`, False where it is not there at all; None where it always is.
    """

    looks: list[Look]
    paths: Floats
    shown: NDArray[np.bool_] | None = None

    def look(self, frame: int) -> Look:
        return self.looks[frame if len(self.looks) > 1 else 0]

    def boxes_xyxy(self) -> Floats:
        """Box of the opaque part in every frame, `[T, 4]` in scene pixels; NaN where not shown."""
        boxes = np.empty((len(self.paths), 4))
        for frame, path in enumerate(self.paths):
            points = self.look(frame).hull @ path[:, :2].T + path[:, 2]
            boxes[frame] = *points.min(axis=0), *points.max(axis=0)
        if self.shown is not None:
            boxes[~self.shown] = np.nan
        return boxes

    def moved(self, offsets: Floats) -> Layer:
        """The same moved by `[T, 2]` scene pixels."""
        paths = self.paths.copy()
        paths[:, :, 2] += offsets
        return replace(self, paths=paths)


class Scene:
    """A simulated clip; see `re3.data.clip.Clip`.

    Args:
        size: width and height of the scene in pixels.
        layers: from back to front, the background first.
        target: index of the object's layer.
        fill: BGR colour outside the scene.
        still: the picture that the object was cut from, where that is known.
        leaps: see `re3.data.clip.Clip`.
    """

    def __init__(
        self,
        size: tuple[int, int],
        layers: list[Layer],
        target: int,
        fill: tuple[float, float, float],
        leaps: bool = False,
        still: Still | None = None,
    ) -> None:
        self.size = size
        self.leaps = leaps
        self.still = still
        self.layers = layers
        self.target = target
        self.fill = fill
        self.boxes_xyxy = _inside(layers[target].boxes_xyxy(), size)
        self.visible = np.array([self._visible(t) for t in range(len(self.boxes_xyxy))])

    @property
    def frame_xyxy(self) -> Floats:
        return np.array([0.0, 0.0, *self.size])

    def crop(self, frame: int, region_xyxy: ArrayLike, size: int) -> NDArray[np.uint8]:
        return self.render(frame, region_xyxy, size, size)

    def outline(self, frame: int, region_xyxy: ArrayLike, cells: int) -> NDArray[np.float32]:
        region = np.asarray(region_xyxy, dtype=np.float64)
        side = OUTLINE_FINENESS * cells
        seen, _ = self._seen(frame, geometry.crop_transform(region, side, side), side)
        shares = cv2.resize(seen.astype(np.float32), (cells, cells), interpolation=cv2.INTER_AREA)
        return np.asarray(shares, dtype=np.float32)

    def render(
        self, frame: int, region_xyxy: ArrayLike, width: int, height: int
    ) -> NDArray[np.uint8]:
        """A region of a frame as uint8 `[height, width, 3]` BGR."""
        region = np.asarray(region_xyxy, dtype=np.float64)
        scene_to_crop = geometry.crop_transform(region, width, height)
        canvas = self._background(frame, scene_to_crop, width, height)
        for layer in self.layers[1:]:
            if layer.shown is not None and not layer.shown[frame]:
                continue
            _blend(canvas, layer.look(frame), _to_crop(layer.paths[frame], scene_to_crop))
        self._blank_outside(canvas, region)
        return canvas

    def _background(
        self, frame: int, scene_to_crop: Floats, width: int, height: int
    ) -> NDArray[np.uint8]:
        layer = self.layers[0]
        return cv2.warpAffine(
            layer.look(frame).image,
            _to_crop(layer.paths[frame], scene_to_crop),
            (width, height),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REFLECT,
        )

    def _blank_outside(self, canvas: NDArray[np.uint8], region: Floats) -> None:
        height, width = canvas.shape[:2]
        scale = np.array([width, height]) / (region[2:] - region[:2])
        low = np.round((0 - region[:2]) * scale).astype(int)
        high = np.round((np.array(self.size) - region[:2]) * scale).astype(int)
        canvas[: max(low[1], 0)] = self.fill
        canvas[max(high[1], 0) :] = self.fill
        canvas[:, : max(low[0], 0)] = self.fill
        canvas[:, max(high[0], 0) :] = self.fill

    def _visible(self, frame: int) -> float:
        """Share of the object that no occluder hides, on a grid of 24 x 24 over its box."""
        if np.isnan(self.boxes_xyxy[frame, 0]):
            return 0.0
        side = 24
        scene_to_grid = geometry.crop_transform(self.boxes_xyxy[frame], side, side)
        seen, whole = self._seen(frame, scene_to_grid, side)
        total = float(whole.sum())
        return float(seen.sum()) / total if total else 0.0

    def _seen(
        self, frame: int, scene_to_grid: Floats, side: int
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Where the object is seen on a grid `[side, side]`, and where it is, seen or not."""
        hidden = np.zeros((side, side), dtype=np.uint8)
        opaque = hidden
        for index, layer in enumerate(self.layers[self.target :]):
            if layer.shown is not None and not layer.shown[frame]:
                continue
            alpha = layer.look(frame).alpha
            assert alpha is not None, "only the background has no alpha"
            cover = cv2.warpAffine(alpha, _to_crop(layer.paths[frame], scene_to_grid), (side, side))
            if index == 0:
                opaque = cover
            else:
                hidden = np.maximum(hidden, cover)
        whole = opaque > 127
        return whole & (hidden <= 127), whole


OUTLINE_FINENESS = 4
"""Pixels a side of which each cell of an outline is the mean."""

LEAST_INSIDE = 0.15
"""An object of which less than this share is inside the scene counts as absent."""


def _inside(boxes_xyxy: Floats, size: tuple[int, int]) -> Floats:
    """Boxes cut at the border, as benchmarks annotate them; NaN where too little is left."""
    inside = np.clip(boxes_xyxy, 0.0, np.array([*size, *size]))
    share = np.prod(inside[:, 2:] - inside[:, :2], axis=1)
    share /= np.prod(boxes_xyxy[:, 2:] - boxes_xyxy[:, :2], axis=1)
    return np.where(share[:, None] < LEAST_INSIDE, np.nan, inside)


def _to_crop(path: Floats, scene_to_crop: Floats) -> Floats:
    """Compose picture -> scene (pixel corners) with scene -> crop (OpenCV's pixel centres)."""
    # A picture's pixel centre 0 lies at corner coordinate 0.5; the scene's likewise.
    matrix = path[:, :2]
    offset = path[:, 2] + matrix @ np.array([0.5, 0.5]) - 0.5
    return np.column_stack(
        [
            scene_to_crop[:, :2] @ matrix,
            scene_to_crop[:, :2] @ offset + scene_to_crop[:, 2],
        ]
    )


def _blend(canvas: NDArray[np.uint8], look: Look, transform: Floats) -> None:
    """Draw a layer on the canvas, working on the rectangle it touches only."""
    assert look.alpha is not None, "the background is not blended"
    points = _corners(look.alpha) @ transform[:, :2].T + transform[:, 2]
    low = np.maximum(np.floor(points.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(points.max(axis=0)).astype(int) + 1, canvas.shape[1::-1])
    if (high <= low).any():
        return
    local = transform.copy()
    local[:, 2] -= low
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    image = cv2.warpAffine(look.image, local, size, borderMode=cv2.BORDER_REPLICATE)
    alpha = cv2.warpAffine(look.alpha, local, size)[:, :, None].astype(np.uint16)
    part = canvas[low[1] : high[1], low[0] : high[0]]
    part[:] = ((image * alpha + part * (255 - alpha) + 127) // 255).astype(np.uint8)


def _corners(image: NDArray[np.uint8]) -> Floats:
    height, width = image.shape[:2]
    return np.array([[0, 0], [width, 0], [0, height], [width, height]], dtype=np.float64)


def _hull(alpha: NDArray[np.uint8]) -> Floats:
    """Convex hull `[N, 2]` of the opaque pixels' outer corners."""
    rows, columns = np.nonzero(alpha > 127)
    if len(rows) == 0:  # shrunk to nothing: the whole picture stands for it
        return _corners(alpha)
    points = np.stack([columns, rows], axis=1).astype(np.float32)
    hull = cv2.convexHull(points)[:, 0].astype(np.float64)
    return np.concatenate([hull + np.array(offset) for offset in ((0, 0), (1, 0), (0, 1), (1, 1))])
