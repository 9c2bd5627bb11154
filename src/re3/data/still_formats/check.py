"""Look stills over without simulating anything: what is in them, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.formats import looks_like_clips
from re3.data.formats.files import subfolders
from re3.data.still_formats import STILL_FORMATS, StillFormat, find_here, find_stills
from re3.data.still_formats.picture import Picture, PictureEntry


@dataclass(frozen=True)
class StillFinding:
    """What is wrong with a picture, or with the file that annotates all of them.

    Attributes:
        name: of the picture or the file.
        errors: what makes it unusable.
        warnings: what looks odd.
    """

    name: str
    errors: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass
class StillsReport:
    """What a folder of stills holds.

    Attributes:
        formats: names of the formats found, each once.
        pictures: pictures with an annotation, those that are broken included.
        objects: boxes with an area, of the pictures that are not broken.
        outlines: those of them with an outline.
        findings: the pictures with something wrong or odd, in the order of the dataset.
    """

    formats: list[str] = field(default_factory=list)
    pictures: int = 0
    objects: int = 0
    outlines: int = 0
    findings: list[StillFinding] = field(default_factory=list)


def still_folders(folder: Path, format: str | None = None) -> list[tuple[StillFormat, Path]]:
    """The folders of annotated stills in a folder; datasets of sequences are not searched.

    Raises:
        ValueError, OSError: a folder looks like several formats, or holds nothing in the format
            named; see `find_stills`.
    """
    if format is not None:
        return find_stills(folder, format)
    if found := find_here(folder):
        return [(found, folder)]
    if looks_like_clips(folder):
        return []
    return [item for child in subfolders(folder) for item in still_folders(child)]


def is_still_format(name: str | None) -> bool:
    """Whether a format's name is that of stills."""
    return any(known.name == name for known in STILL_FORMATS)


def check_stills(
    folders: list[tuple[StillFormat, Path]],
    *,
    decode: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> StillsReport:
    """Read annotations picture by picture and look for what is wrong.

    A broken picture becomes a finding with its error, and the rest is read all the same.

    Args:
        folders: from `still_folders`.
        decode: also decode every picture and every outline. Without, sizes are read from the
            pictures' headers.
        on_progress: called after each picture with the number done and the number in all.
    """
    report = StillsReport(list(dict.fromkeys(known.name for known, _ in folders)))
    entries: list[PictureEntry] = []
    for known, folder in folders:
        try:
            entries += known.entries(folder)
        except (ValueError, OSError) as error:
            report.findings.append(StillFinding(folder.name, (str(error),)))
    report.pictures = len(entries)
    for done, entry in enumerate(entries, start=1):
        try:
            picture = entry.read()
            size = picture.checked_size()
            picture = picture.with_fitting_masks(size)
            if decode:
                _decode(picture, size)
        except (ValueError, OSError) as error:
            report.findings.append(StillFinding(entry.name, (str(error),)))
        else:
            areas = _has_area(picture)
            report.objects += int(areas.sum())
            report.outlines += sum(
                mask is not None and bool(area)
                for mask, area in zip(picture.masks, areas, strict=True)
            )
            if warnings := tuple(_oddities(picture, size)):
                report.findings.append(StillFinding(entry.name, warnings=warnings))
        if on_progress is not None:
            on_progress(done, len(entries))
    return report


def _has_area(picture: Picture) -> NDArray[np.bool_]:
    boxes = picture.boxes_xywh
    return np.logical_and(np.isfinite(boxes).all(axis=1), (boxes[:, 2:] > 0).all(axis=1))


def _oddities(picture: Picture, size: tuple[int, int]) -> Iterator[str]:
    yield from picture.notes
    areas = _has_area(picture)
    if without := int((~areas).sum()):
        yield f"{without} of {len(areas)} boxes without an area, which are left out"
    boxes = picture.boxes_xywh[areas]
    limits = np.array((1, 1) if picture.relative else size, dtype=np.float64)
    low, high = boxes[:, :2], boxes[:, :2] + boxes[:, 2:]
    gone = ((low >= limits) | (high <= 0)).any(axis=1)
    if gone.any():
        yield f"{int(gone.sum())} of {len(areas)} boxes outside the picture"


def _decode(picture: Picture, size: tuple[int, int]) -> None:
    if cv2.imread(str(picture.image), cv2.IMREAD_COLOR) is None:
        raise ValueError(f"{picture.image} cannot be read as an image; restore it or leave it out")
    for mask in picture.masks:
        if mask is not None:
            mask.read(*size)
