"""What is written in the options of `re3 track`."""

from __future__ import annotations

from dataclasses import dataclass

from re3.apps.tracking import Box
from re3.video.grey_levels import Range


@dataclass(frozen=True)
class Span:
    """The frames that are tracked.

    Attributes:
        first: 0-based in the source.
        count: at most, or None for all.
    """

    first: int
    count: int | None

    @classmethod
    def of_options(cls, start: int, end: int | None, count: int | None) -> Span:
        """From --start-frame, --end-frame and --max-frames; raises ValueError without a frame."""
        if end is None:
            return cls(start, count)
        if end < start:
            raise ValueError(
                f"--end-frame {end} is before --start-frame {start}; expected the last frame to "
                "track, counted from 0 in the source"
            )
        return cls(start, min(end - start + 1, count or end - start + 1))


def parse_objects(boxes: list[str], named: list[str], select: bool) -> dict[str, Box]:
    """Name -> box, none to `select` them later; raises ValueError that says what was given."""
    names = ["object"] if len(boxes) == 1 else [f"object-{i + 1}" for i in range(len(boxes))]
    objects = {name: parse_box("--box", box) for name, box in zip(names, boxes, strict=True)}
    for text in named:
        name, equals, numbers = text.rpartition("=")
        if not equals or not name.strip():
            raise ValueError(f"--object {text!r} is not NAME=X,Y,W,H, such as car=10,20,80,40")
        if name.strip() in objects:
            raise ValueError(f"two objects are called {name.strip()!r}; give each its own name")
        objects[name.strip()] = parse_box("--object", numbers)
    if not objects and not select:
        raise ValueError(
            "no object to track; give its box in the first frame: --box X,Y,W,H "
            "(left, top, width, height in pixels), or draw it: --select"
        )
    if objects and select:
        raise ValueError("--select draws the boxes; leave out --box and --object")
    return objects


def parse_range(text: str) -> Range:
    """Two numbers separated by a comma; raises ValueError that names the option."""
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(
            f"--value-range {text!r} is not LOW,HIGH: the lowest and the highest value of 16-bit "
            "pixels, such as 7000,8020"
        ) from error
    return low, high


def parse_box(option: str, text: str) -> Box:
    """Four numbers separated by commas; raises ValueError that names the option."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(
            f"{option} {text!r} is not X,Y,W,H: four numbers, left, top, width and height in "
            "pixels, separated by commas, such as 120,80,60,140"
        ) from error
    return x, y, w, h
