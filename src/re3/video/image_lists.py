"""Lists of image files: their order, and what in their names is not as in a recording."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

from re3.natural_order import natural_key
from re3.video.base import SourceError

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"})

_NAMED_GAPS = 3
"""Gaps given in a note at most."""


def sorted_images(paths: Iterable[Path]) -> list[Path]:
    """The images among the files, hidden ones left out, `img2` before `img10`."""
    images = (p for p in paths if is_image(p) and not p.name.startswith("."))
    # The path itself decides between img1 and img01.
    return sorted(images, key=lambda path: (natural_key(str(path)), str(path)))


def is_image(path: Path) -> bool:
    """Whether the name is that of an image."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def refuse_twins(paths: Sequence[Path]) -> None:
    """Refuse images that differ only in their ending, such as a frame and its mask.

    Raises:
        SourceError: two of them lie in one folder; the message says how to choose.
    """
    seen: dict[Path, Path] = {}
    for path in paths:
        other = seen.setdefault(path.with_suffix(""), path)
        if other != path:
            choices = [str(path.parent / f"*{each.suffix}") for each in (other, path)]
            raise SourceError(
                f"{path.parent} holds {other.name} and {path.name}, which would both be frames; "
                f"expected one image a frame: give {choices[0]!r} or {choices[1]!r}, in quotes"
            )


def relative_names(paths: Sequence[Path]) -> list[str]:
    """Names of the images, relative to the folder that all of them are in, with `/`."""
    parents = {path.parent for path in paths}
    if len(parents) == 1:
        return [path.name for path in paths]
    common = os.path.commonpath([parent.resolve() for parent in parents])
    return [
        Path(os.path.relpath(path.parent.resolve() / path.name, common)).as_posix()
        for path in paths
    ]


def notes_on(name: str, paths: Sequence[Path]) -> list[str]:
    """Sentences on names of several patterns, and on numbers that are missing.

    Args:
        name: of the source.
        paths: its images, in order.
    """
    patterns = Counter(_pattern(path) for path in paths)
    if len(patterns) > 1:
        shown = ", ".join(f"{count} {pattern}" for pattern, count in patterns.most_common(4))
        return [
            f"{name} holds images of {len(patterns)} kinds of names ({shown}); all of them are "
            "frames, in the order of their names: choose some with a pattern in quotes"
        ]
    numbers = [_number(path) for path in paths]
    known = [number for number in numbers if number is not None]
    # Names with another number in them, such as a date, count by that as well.
    if len(known) < len(paths) or len({path.parent for path in paths}) > 1:
        return []
    steps = [later - earlier for earlier, later in pairwise(known)]
    if all(step == 1 for step in steps) or any(step < 1 for step in steps):
        return []
    after = "; every image is the frame after the one before it"
    if len(set(steps)) == 1 and len(steps) > 1:
        return [
            f"{name}: images are numbered {known[0]} to {known[-1]} in steps of {steps[0]}{after}"
        ]
    gaps = [
        f"{a + 1}" if b == a + 2 else f"{a + 1} to {b - 1}" for a, b in pairwise(known) if b > a + 1
    ]
    missing = known[-1] - known[0] + 1 - len(known)
    named = ", ".join(gaps[:_NAMED_GAPS]) + (", …" if len(gaps) > _NAMED_GAPS else "")
    are = "number is" if missing == 1 else "numbers are"
    return [f"{name}: {missing} {are} missing among its images ({named}){after}"]


def _pattern(path: Path) -> str:
    """The name with numbers as `#`."""
    return re.sub(r"\d+", "#", path.name)


def _number(path: Path) -> int | None:
    """The last number in the name."""
    found = re.findall(r"\d+", path.stem)
    return int(found[-1]) if found else None
