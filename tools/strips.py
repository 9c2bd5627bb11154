"""Strips of tracked frames for the documentation: what the tracker really did in a clip."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from re3 import MultiTracker
from re3.result import Result
from re3.video import draw_results, open_source

Image = NDArray[np.uint8]
Box = tuple[float, float, float, float]

PERSON = "person.mp4"
"""The bundled clip; all others are in the folder of `--clips`."""
PERSON_CLIP = Path(__file__).parents[1] / "examples" / "clips" / PERSON
PICTURE_WIDTH = 320
GAP = 4


@dataclass(frozen=True)
class Strip:
    """A clip, where tracking starts in it, and what is shown.

    Attributes:
        clip: file name of a clip.
        objects: name -> x, y, width, height in pixels of the first frame.
        shown: indices of frames of the clip; the first is where tracking starts.
        columns: pictures in a row.
    """

    clip: str
    objects: dict[str, Box]
    shown: tuple[int, ...]
    columns: int = 2


STRIPS = {
    "demo": Strip(PERSON, {"object": (368, 58, 158, 374)}, (0, 30, 60, 90, 119), columns=5),
    "several": Strip(
        "car-detection.mp4",
        {"blue": (98, 50, 160, 300), "red": (310, 150, 165, 282)},
        (205, 211, 217),
        columns=3,
    ),
    "spread": Strip(PERSON, {"person": (368, 58, 158, 374)}, (0, 96, 112, 115, 117, 119)),
    "look-alike": Strip(
        "bottle-detection.mp4", {"bottle": (54, 104, 70, 210)}, (0, 206, 228, 300, 387, 435)
    ),
    "left": Strip("car-detection.mp4", {"car": (98, 50, 160, 300)}, (205, 214, 223, 230, 238, 245)),
    "half-seen": Strip(
        "car-detection.mp4", {"car": (275, 215, 200, 217)}, (68, 74, 80, 86, 93, 99)
    ),
    "loose": Strip(PERSON, {"loose": (300, 20, 300, 412)}, (0, 30, 108), columns=3),
}
"""Name of the picture -> what it shows."""


def find_clip(clip: str, clips: Path) -> Path:
    """The path of a clip.

    Raises:
        FileNotFoundError: it is not in the folder; says where it comes from.
    """
    path = PERSON_CLIP if clip == PERSON else clips / clip
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} does not exist; give the folder of Intel's sample videos "
            "(https://github.com/intel-iot-devkit/sample-videos) with --clips"
        )
    return path


def track(
    path: Path, objects: dict[str, Box], first: int, last: int
) -> list[tuple[Image, list[Result]]]:
    """Frames `first` to `last` of a clip with the results in each."""
    tracker, seen = MultiTracker(), []
    with open_source(path, start_frame=first) as source:
        for index, frame in enumerate(source, first):
            if index == first:
                for name, box in objects.items():
                    tracker.add(frame.image, box, name)
            else:
                tracker.update(frame.image)
            seen.append((frame.image, list(tracker.results.values())))
            if index == last:
                break
    return seen


def make_strip(strip: Strip, clips: Path) -> Image:
    """The frames of a strip side by side, boxes drawn in, each with its number."""
    first = strip.shown[0]
    seen = track(find_clip(strip.clip, clips), strip.objects, first, strip.shown[-1])
    pictures = [_picture(*seen[index - first], f"frame {index}") for index in strip.shown]
    blank = np.full_like(pictures[0], 255)
    pictures += [blank] * (-len(pictures) % strip.columns)
    rows = [pictures[i : i + strip.columns] for i in range(0, len(pictures), strip.columns)]
    return beside([beside(row, axis=1) for row in rows], axis=0)


def beside(pictures: list[Image], axis: int) -> Image:
    """Pictures of one size in a row (axis 1) or a column (axis 0), white between them."""
    shape = list(pictures[0].shape)
    shape[axis] = GAP
    gap = np.full(shape, 255, np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=axis)


def _picture(image: Image, results: list[Result], caption: str) -> Image:
    scale = PICTURE_WIDTH / image.shape[1]
    size = (PICTURE_WIDTH, round(image.shape[0] * scale))
    # Drawn in after scaling, so that lines and letters keep their size.
    small = [replace(r, box_xywh=tuple(v * scale for v in r.box_xywh)) for r in results]
    picture = draw_results(cv2.resize(image, size, interpolation=cv2.INTER_AREA), small)
    return write(picture, caption)


def write(picture: Image, caption: str) -> Image:
    """Letters on a dark plate in the lower right corner; changes the picture and returns it."""
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.42
    (wide, high), _ = cv2.getTextSize(caption, font, scale, 1)
    height, width = picture.shape[:2]
    left, top = width - wide - 8, height - high - 10
    cv2.rectangle(picture, (left, top), (width, height), (30, 30, 30), cv2.FILLED)
    origin = (left + 4, height - 5)
    cv2.putText(picture, caption, origin, font, scale, (245, 245, 245), 1, cv2.LINE_AA)
    return picture
