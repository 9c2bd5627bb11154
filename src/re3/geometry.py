"""Boxes, overlap, crop regions and the codec between frame and crop coordinates.

Conventions, everywhere in re3:

* Pixels are squares: the top-left corner of the top-left pixel is (0, 0) and its centre (0.5, 0.5).
  A box that covers the whole of a 640 x 480 frame is `(0, 0, 640, 480)` as xywh.
* `box_xywh` is left, top, width, height; `box_xyxy` is left, top, right, bottom; `box_cxcywh` is
  centre and size. All are float arrays `[..., 4]` in pixels unless a name says otherwise.
* A *region* is the box_xyxy of a part of the frame that is cut out and warped to a square crop.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

BoxFormat = Literal["xywh", "xyxy", "cxcywh"]
Floats = NDArray[np.float64]

REGRESSION_SCALE = 10.0
"""The network regresses corners in crop coordinates times this (as the paper's public code does).

With a crop of twice the box an object that has not moved gives 2.5, 2.5, 7.5, 7.5.
"""

LARGEST_BOX = 20
"""Width and height of a given box, in those of the frame, beyond which it is taken for an error."""

SMALLEST_SIDE = 1.0
"""Width and height of a box never fall below this many pixels: a crop needs something to cut."""


def convert(boxes: ArrayLike, source: BoxFormat, target: BoxFormat) -> Floats:
    """Convert boxes `[..., 4]` between formats; raises ValueError on another shape."""
    boxes = _checked(boxes, source)
    if source == target:
        return boxes.copy()
    first, second = boxes[..., :2], boxes[..., 2:]
    if source == "xywh":
        low, high = first, first + second
    elif source == "xyxy":
        low, high = first, second
    else:
        low, high = first - second / 2, first + second / 2
    if target == "xywh":
        return np.concatenate([low, high - low], axis=-1)
    if target == "xyxy":
        return np.concatenate([low, high], axis=-1)
    return np.concatenate([(low + high) / 2, high - low], axis=-1)


def _checked(boxes: ArrayLike, order: BoxFormat) -> Floats:
    """Boxes as floats; raises ValueError where they are not `[..., 4]`."""
    floats = np.asarray(boxes, dtype=np.float64)
    if floats.shape[-1:] != (4,):
        raise ValueError(f"boxes have shape {floats.shape}; expected [..., 4] in {order} order")
    return floats


def iou_xyxy(a: ArrayLike, b: ArrayLike) -> Floats:
    """Intersection over union of boxes_xyxy `[..., 4]`, broadcast against each other.

    Returns `[...]` in 0..1. Boxes without area overlap nothing (0); NaN in gives NaN out.
    """
    a = np.asarray(a, dtype=np.float64)
    b = np.asarray(b, dtype=np.float64)
    overlap = np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])
    intersection = np.prod(np.maximum(overlap, 0.0), axis=-1)
    area_a = np.prod(np.maximum(a[..., 2:] - a[..., :2], 0.0), axis=-1)
    area_b = np.prod(np.maximum(b[..., 2:] - b[..., :2], 0.0), axis=-1)
    union = area_a + area_b - intersection
    # A union of exactly zero (two empty boxes) must not divide; NaN stays NaN.
    return np.where(union == 0, 0.0, intersection / np.where(union == 0, 1.0, union))


def iou_xywh(a: ArrayLike, b: ArrayLike) -> Floats:
    """Intersection over union of boxes_xywh `[..., 4]`; see `iou_xyxy`."""
    return iou_xyxy(convert(a, "xywh", "xyxy"), convert(b, "xywh", "xyxy"))


def search_region(boxes_xyxy: ArrayLike, context: float) -> Floats:
    """The region centred on each box and `context` times its width and height (Re3, sec. III-A).

    Args:
        boxes_xyxy: `[..., 4]` in pixels.
        context: the paper's padding is 2.0.

    Returns:
        regions `[..., 4]` as xyxy in pixels; may reach outside the frame.

    Raises:
        ValueError: boxes of another shape.
    """
    boxes = _checked(boxes_xyxy, "xyxy")
    low, high = boxes[..., :2], boxes[..., 2:]
    middle, reach = (low + high) / 2, np.maximum(high - low, SMALLEST_SIDE) * context / 2
    return np.concatenate([middle - reach, middle + reach], axis=-1)


def snap(regions_xyxy: ArrayLike) -> Floats:
    """Regions `[..., 4]` moved to a grid of about 1/256 of their shorter side.

    Rounding differs between engines and batch sizes in the last bit. OpenCV interpolates at 1/32
    of a pixel, which makes such a difference visible in the next crop, and so on: without the
    grid a batch was a tenth of a pixel away from single steps after 40 frames. Snapped regions
    are equal unless they lie astride a boundary; nothing is lost, since boxes are decoded from
    the snapped region.
    """
    regions = np.asarray(regions_xyxy, dtype=np.float64)
    size = regions[..., 2:] - regions[..., :2]
    side = np.minimum(size[..., :1], size[..., 1:])
    grid = 2.0 ** np.floor(np.log2(side / 256))  # powers of two: exact in floating point
    return np.rint(regions / grid) * grid


def encode(boxes_xyxy: ArrayLike, regions_xyxy: ArrayLike) -> Floats:
    """Boxes in the frame to regression targets: corners in the crop's 0..1 frame times the scale.

    Args:
        boxes_xyxy, regions_xyxy: `[..., 4]` in pixels, broadcast against each other.

    Returns:
        `[..., 4]`: x1, y1, x2, y2, each times `REGRESSION_SCALE`.
    """
    boxes = np.asarray(boxes_xyxy, dtype=np.float64)
    regions = np.asarray(regions_xyxy, dtype=np.float64)
    origin, size = _origin_and_size(regions)
    return (boxes - origin) / size * REGRESSION_SCALE


def decode(corners: ArrayLike, regions_xyxy: ArrayLike) -> Floats:
    """The inverse of `encode`: network outputs `[..., 4]` to boxes_xyxy `[..., 4]` in pixels."""
    corners = np.asarray(corners, dtype=np.float64)
    regions = np.asarray(regions_xyxy, dtype=np.float64)
    origin, size = _origin_and_size(regions)
    return corners / REGRESSION_SCALE * size + origin


def _origin_and_size(regions: Floats) -> tuple[Floats, Floats]:
    low, high = regions[..., :2], regions[..., 2:]
    return np.concatenate([low, low], axis=-1), np.concatenate([high - low, high - low], axis=-1)


def crop_transform(region_xyxy: ArrayLike, width: int, height: int) -> Floats:
    """Affine map `[2, 3]` from frame to a crop of that size, in OpenCV's pixel-centre coordinates.

    The region's corners fall on the crop's corners; the aspect ratio is not kept.
    """
    left, top, right, bottom = np.asarray(region_xyxy, dtype=np.float64)
    scale_x, scale_y = width / (right - left), height / (bottom - top)
    # OpenCV puts integer coordinates at pixel centres, we put them at pixel corners: half a pixel.
    return np.array(
        [
            [scale_x, 0.0, (0.5 - left) * scale_x - 0.5],
            [0.0, scale_y, (0.5 - top) * scale_y - 0.5],
        ]
    )


def crop(
    image: NDArray[np.uint8],
    region_xyxy: ArrayLike,
    size: int,
    fill: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> NDArray[np.uint8]:
    """Cut a region out of an image and warp it to a square.

    A region larger than the crop is averaged rather than sampled, so that small details do not
    flicker from frame to frame.

    Args:
        image: uint8 `[H, W, 3]`.
        region_xyxy: `[4]` in pixels; may reach outside the image, or lie outside altogether.
        size: side of the square crop in pixels.
        fill: the colour outside the image.

    Returns:
        uint8 `[size, size, 3]`.
    """
    height, width = image.shape[:2]
    left, top, right, bottom = np.asarray(region_xyxy, dtype=np.float64)
    shrink = max((right - left), (bottom - top)) / size
    if shrink < SHRINK_BEFORE_WARP:
        return cv2.warpAffine(
            image,
            crop_transform((left, top, right, bottom), size, size),
            (size, size),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=fill,
        )
    # Average whole blocks of pixels first, by halving, then warp what remains. OpenCV halves 854 x
    # 480 pixels in 0.1 ms, and averages them by any other factor in 0.5 to 1.2 ms.
    x0, y0 = max(int(np.floor(left)), 0), max(int(np.floor(top)), 0)
    x1, y1 = min(int(np.ceil(right)), width), min(int(np.ceil(bottom)), height)
    if x1 <= x0 or y1 <= y0:
        return np.full((size, size, 3), fill, dtype=np.uint8)
    block_x = _power_of_two(min((right - left) / size, x1 - x0))
    block_y = _power_of_two(min((bottom - top) / size, y1 - y0))
    # The blocks lie on a grid of the image: where a region moves a little, they stay.
    x0, y0 = x0 // block_x * block_x, y0 // block_y * block_y
    columns, rows = -((x0 - x1) // block_x), -((y0 - y1) // block_y)
    part = image[y0:y1, x0:x1]
    lacking = rows * block_y - (y1 - y0), columns * block_x - (x1 - x0)
    if any(lacking):  # complete the last blocks
        part = cv2.copyMakeBorder(part, 0, lacking[0], 0, lacking[1], cv2.BORDER_REPLICATE)
    small = part
    while small.shape[:2] != (rows, columns):
        half = max(columns, small.shape[1] // 2), max(rows, small.shape[0] // 2)
        # Half way between two pixels, linear interpolation is their mean.
        small = cv2.resize(small, half, interpolation=cv2.INTER_LINEAR)
    offset = np.array([x0, y0, x0, y0])
    region = (np.array([left, top, right, bottom]) - offset) / [block_x, block_y, block_x, block_y]
    return cv2.warpAffine(
        small,
        crop_transform(region, size, size),
        (size, size),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=fill,
    )


def _power_of_two(limit: float) -> int:
    """The largest power of two up to a limit, 1 or more."""
    return 1 << max(int(limit), 1).bit_length() - 1


SHRINK_BEFORE_WARP = 2.0
"""Regions that shrink by this or more along either side are averaged before the warp, which by
itself looks at two pixels a side."""


def clip_inside(boxes_xyxy: ArrayLike, width: float, height: float) -> Floats:
    """Keep boxes usable: finite size of at least `SMALLEST_SIDE`, centre within the frame.

    The box may still reach outside the frame, as objects do.

    Args:
        boxes_xyxy: `[..., 4]` in pixels, finite.
        width, height: of the frame in pixels.

    Raises:
        ValueError: boxes of another shape.
    """
    boxes = _checked(boxes_xyxy, "xyxy")
    low, high = boxes[..., :2], boxes[..., 2:]
    limit = np.array([width, height], dtype=np.float64)
    middle = np.minimum(np.maximum((low + high) / 2, 0.0), limit)
    # Four frames wide is far past any real object and keeps a diverging size finite.
    half = np.minimum(np.maximum(high - low, SMALLEST_SIDE), 4 * limit) / 2
    return np.concatenate([middle - half, middle + half], axis=-1)


def sides_near(boxes_xyxy: ArrayLike, like_xyxy: ArrayLike, factor: float) -> Floats:
    """Boxes about the same centres, no side of which differs from another box's by more.

    Args:
        boxes_xyxy, like_xyxy: `[..., 4]` in pixels, broadcast against each other.
        factor: 1 or more; each side is brought to between 1 / factor and factor times the other's.
    """
    boxes = convert(boxes_xyxy, "xyxy", "cxcywh")
    like = convert(like_xyxy, "xyxy", "cxcywh")[..., 2:]
    boxes[..., 2:] = np.clip(boxes[..., 2:], like / factor, like * factor)
    return convert(boxes, "cxcywh", "xyxy")


def validate_box(box_xywh: ArrayLike, width: int, height: int) -> Floats:
    """Check a box given by a user against its frame.

    Returns:
        the box as float64 `[4]`, unchanged.

    Raises:
        ValueError: not four finite numbers, no area, less than a pixel, or wholly outside the
            frame.
    """
    try:
        box = np.asarray(box_xywh, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"box {box_xywh!r} is not four numbers (x, y, width, height)") from error
    given = f"box {tuple(box.ravel().tolist())}"
    if box.shape != (4,):
        raise ValueError(
            f"{given} has shape {box.shape}; expected four numbers x, y, width, height"
        )
    if not np.isfinite(box).all():
        raise ValueError(f"{given} holds NaN or infinity; expected finite x, y, width, height")
    x, y, w, h = box
    if w <= 0 or h <= 0:
        raise ValueError(f"{given} has no area; expected width and height above 0 pixels")
    if max(w, h) < SMALLEST_SIDE:
        raise ValueError(
            f"{given} is smaller than a pixel; expected x, y, width, height in pixels. Multiply "
            f"shares of the frame by its {width} x {height} pixels"
        )
    if w > LARGEST_BOX * width or h > LARGEST_BOX * height:
        raise ValueError(
            f"{given} is more than {LARGEST_BOX} times as large as the frame of {width} x {height} "
            "pixels; expected x, y, width, height in pixels of the frame"
        )
    if x >= width or y >= height or x + w <= 0 or y + h <= 0:
        raise ValueError(
            f"{given} lies wholly outside the frame of {width} x {height} pixels; "
            "expected x, y, width, height with at least a part inside"
        )
    return box
