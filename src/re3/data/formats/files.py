"""What all readers of datasets share: folders, images, texts of numbers, boxes and flags.

Readers look at names of files and read texts; no image is decoded here.
"""

from __future__ import annotations

import configparser
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.data.plain import read_boxes
from re3.data.sequence import Sequence
from re3.natural_order import natural_key
from re3.video.images import is_image, sorted_images

Floats = NDArray[np.float64]
ABSENT = (np.nan, np.nan, np.nan, np.nan)

_PART = re.compile(r"(train|training|val|valid|validation|test|testing|dev)(_\d+)?", re.IGNORECASE)


@dataclass(frozen=True)
class Entry:
    """One clip of a dataset, found but not read yet.

    Attributes:
        name: the clip's name.
        read: reads its tracks; raises ValueError or OSError, with a message that names the file,
            where the clip is broken. A track without any box is left out.
    """

    name: str
    read: Callable[[], list[Sequence]]


def dataset_name(folder: Path) -> str:
    """The name of a dataset: that of its folder, `GOT-10k-val` of a part such as `GOT-10k/val`."""
    folder = folder.absolute()
    if folder.name == "..":
        folder = folder.resolve()
    if _PART.fullmatch(folder.name) and folder.parent.name:
        return f"{folder.parent.name}-{folder.name}"
    return folder.name


def subfolders(folder: Path) -> list[Path]:
    """The folders directly in a folder in natural order; hidden ones are left out."""
    if not folder.is_dir():
        return []
    # Not iterdir: asking each of ten thousand images whether it is a folder takes seconds.
    with os.scandir(folder) as items:
        names = [item.name for item in items if item.is_dir() and not item.name.startswith(".")]
    return [folder / name for name in sorted(names, key=lambda name: (natural_key(name), name))]


def files_with(folder: Path, suffix: str) -> list[Path]:
    """The files of a folder that end in `suffix`, in natural order; hidden ones are left out."""
    if not folder.is_dir():
        return []
    found = [p for p in folder.iterdir() if p.suffix == suffix and not p.name.startswith(".")]
    return sorted(found, key=lambda path: (natural_key(path.stem), path.name))


def has_images(folder: Path) -> bool:
    """Whether there is an image directly in a folder."""
    if not folder.is_dir():
        return False
    with os.scandir(folder) as items:
        return any(is_image(Path(item.name)) and not item.name.startswith(".") for item in items)


def images_in(folder: Path) -> list[Path]:
    """The images of a folder, in the order a source of frames gives them.

    Raises:
        FileNotFoundError: no such folder, or no image in it.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} does not exist; expected a folder of images")
    images = sorted_images(folder.iterdir())
    if not images:
        raise FileNotFoundError(f"{folder} holds no image; expected the frames of the clip")
    return images


def needed(path: Path, what: str) -> Path:
    """The path, where it is a file.

    Raises:
        FileNotFoundError: it is not; `what` says in the message what it would hold.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; expected {what}")
    return path


def lines_of(path: Path, what: str) -> list[str]:
    """The lines of a text without the empty ones at its end.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is not UTF-8 or is empty.
    """
    try:
        text = needed(path, what).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text ({error}); expected {what}") from error
    lines = text.rstrip().splitlines()
    if not lines:
        raise ValueError(f"{path} is empty; expected {what}")
    return lines


def numbers_of(line: str, where: str, expected: str) -> list[float]:
    """The numbers of a line, separated by commas, semicolons, tabs or spaces.

    Raises:
        ValueError: a field is not a number; the message starts with `where`.
    """
    try:
        return [float(field) for field in re.split(r"[,;\s]+", line.strip()) if field]
    except ValueError:
        raise ValueError(f"{where}: {line.strip()!r} is not numbers; expected {expected}") from None


def truth_of(path: Path, *, first_pixel: int) -> Floats:
    """Read `x,y,width,height` lines.

    Args:
        path: the text.
        first_pixel: what the dataset calls the first column and row of an image, 0 or 1.

    Returns:
        boxes_xywh `[T, 4]`, 0-based; NaN where the line says so or its box has no area.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a line is not four numbers; names the file and the line.
    """
    return usable(read_boxes(needed(path, "x,y,width,height a line, a line a frame")), first_pixel)


def usable(boxes_xywh: ArrayLike, first_pixel: int = 0) -> Floats:
    """The boxes `[T, 4]` moved to 0-based pixels, NaN throughout where one has no area."""
    boxes = np.array(boxes_xywh, dtype=np.float64)
    boxes[~(np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] > 0).all(axis=1))] = np.nan
    boxes[:, :2] -= first_pixel
    return boxes


def check_count(rows: int, text: Path, images: int, folder: Path) -> None:
    """Raise ValueError unless an annotation has a row for every image."""
    if rows != images:
        raise ValueError(
            f"{text} has {rows} lines, but {folder} {images} images; expected a line a frame: is "
            "a file missing, or is one of another clip?"
        )


def pad_to_images(boxes: Floats, images: int) -> Floats:
    """Boxes `[images, 4]`: those of a test part, which gives away the first frame alone.

    A single box for several images is followed by NaN; any other number stays as it is.
    """
    if len(boxes) != 1 or images == 1:
        return boxes
    return np.concatenate([boxes, np.full((images - 1, 4), np.nan)])


def flags_of(path: Path, rows: int, *, may_end_early: bool = False) -> NDArray[np.bool_]:
    """Read marks of frames, 0 or 1, a line each or all in one line with commas.

    Args:
        path: the text.
        rows: how many frames there are.
        may_end_early: frames past the end of the text are not marked.

    Raises:
        FileNotFoundError: no such file.
        ValueError: something that is not 0 or 1, or another number of marks.
    """
    flags: list[bool] = []
    for number, line in enumerate(lines_of(path, "0 or 1 for every frame"), start=1):
        where = f"{path}, line {number}"
        values = numbers_of(line, where, "0 or 1")
        if not set(values) <= {0.0, 1.0}:
            raise ValueError(f"{where}: {line.strip()!r}; expected 0 or 1 for every frame")
        flags.extend(value == 1 for value in values)
    if len(flags) > rows or (len(flags) < rows and not may_end_early):
        raise ValueError(f"{path} marks {len(flags)} frames; expected {rows}, one a frame")
    return np.array([*flags, *[False] * (rows - len(flags))], dtype=bool)


def setting(path: Path, section: str, key: str) -> str | None:
    """A value of an `.ini` file; None where the file or the value is missing.

    Raises:
        ValueError: the file is not well formed.
    """
    # Values such as URLs may hold a percent sign, which interpolation would trip over.
    settings = configparser.ConfigParser(interpolation=None)
    try:
        settings.read(path, encoding="utf-8-sig")
    except (configparser.Error, UnicodeDecodeError) as error:
        found = " ".join(str(error).split())
        raise ValueError(f"{path}: {found}; expected [{section}] with {key}") from error
    value = settings.get(section, key, fallback=None)
    return None if value is None else value.strip()


def track(
    boxes_xywh: Mapping[int, ArrayLike], occluded: Mapping[int, bool] | None = None
) -> dict[str, Any]:
    """A track that some frames have a box for, as arguments of `Sequence`.

    Args:
        boxes_xywh: frame -> box, at least one.
        occluded: frame -> whether it is marked; None where the dataset marks nothing.

    Returns:
        `boxes_xywh` from the first frame with a box to the last, NaN in between where there is
        none, `start_frame` and `occluded`.
    """
    frames = range(min(boxes_xywh), max(boxes_xywh) + 1)
    marks = None
    if occluded is not None:
        marks = np.array([occluded.get(t, False) for t in frames])
    return {
        "boxes_xywh": np.array([boxes_xywh.get(t, ABSENT) for t in frames], dtype=np.float64),
        "start_frame": frames.start,
        "occluded": marks,
    }


def track_name(clip: str, key: str | int, tracks: int) -> str:
    """`clip/key` of a clip with several tracks, the clip's name alone of one with a single one."""
    return clip if tracks == 1 else f"{clip}/{key}"
