"""Readers of still pictures in the layouts they are published in, for simulated sequences.

A module a format; each has `detect(folder)`, which looks at the structure and never at the
folder's own name, and `entries(folder)`, which finds the pictures without reading them. What all of
them give are stills whose objects cover `smallest_share` of their picture or more; see
`docs/datasets.md`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from re3.data.formats.files import subfolders
from re3.data.picture_size import WrongSize
from re3.data.still_formats import (
    boxes_index,
    coco,
    imagenet_det,
    mask_folder,
    plain_images,
    voc,
    yolo,
)
from re3.data.still_formats.picture import Picture, PictureEntry
from re3.data.stills import SMALLEST_SHARE, Still


@dataclass(frozen=True)
class StillFormat:
    """A layout of still pictures on disk.

    Attributes:
        name: what a user calls it.
        layout: what a folder has to look like, in a line.
        detect: whether a folder looks like it.
        entries: the pictures of a folder, not read yet.
        still: what is made of a picture with objects of so large a share of it; None without any.
    """

    name: str
    layout: str
    detect: Callable[[Path], bool]
    entries: Callable[[Path], list[PictureEntry]]
    still: Callable[[Picture, float], Still | None] = Picture.still

    def read(self, folder: Path, smallest_share: float) -> list[Still]:
        """The pictures of a folder that have an object large enough.

        Raises:
            FileNotFoundError: a picture is missing.
            ValueError: an annotation is not well formed, or a picture is not of the size that its
                annotation states; the message names the first and counts the others.
        """
        stills = []
        wrong: list[FileNotFoundError | WrongSize] = []
        entries = self.entries(folder)
        for entry in entries:
            try:
                still = self.still(entry.read(), smallest_share)
            except (FileNotFoundError, WrongSize) as error:
                wrong.append(error)
                continue
            if still is not None:
                stills.append(still)
        if len(wrong) > 1:
            raise type(wrong[0])(
                f"{len(wrong)} of {len(entries)} pictures of {folder} are missing or not of the "
                f"size their annotation states, the first of them: {wrong[0]}"
            ) from wrong[0]
        if wrong:
            raise wrong[0]
        return stills


INDEX = StillFormat("boxes", boxes_index.LAYOUT, boxes_index.detect, boxes_index.entries)
PLAIN = StillFormat(
    "images",
    plain_images.LAYOUT,
    plain_images.detect,
    plain_images.entries,
    plain_images.still,
)
STILL_FORMATS = (
    # First: an index says what is in the folder, whatever else the folder looks like.
    INDEX,
    StillFormat("imagenet-det", imagenet_det.LAYOUT, imagenet_det.detect, imagenet_det.entries),
    StillFormat("coco", coco.LAYOUT, coco.detect, coco.entries),
    StillFormat("voc", voc.LAYOUT, voc.detect, voc.entries),
    StillFormat("yolo", yolo.LAYOUT, yolo.detect, yolo.entries),
    StillFormat("masks", mask_folder.LAYOUT, mask_folder.detect, mask_folder.entries),
    # Last: it takes any folder with an image somewhere below.
    PLAIN,
)
ANNOTATED = STILL_FORMATS[:-1]
"""The formats that say where the objects are."""


def read_stills(
    folder: str | Path, format: str | None = None, smallest_share: float = SMALLEST_SHARE
) -> list[Still]:
    """Read pictures in any of the known formats, or several in the folders below.

    Args:
        folder: of the pictures, as it is unpacked, or one somewhere above it.
        format: the name of one of `STILL_FORMATS`; by default the one the folder looks like.
        smallest_share: objects that cover less of their picture are left out; the paper's 0.1
            squared by default.

    Raises:
        NotADirectoryError, FileNotFoundError: no such folder, or a file of it is missing.
        ValueError: no such format; a folder looks like none or like several; a file is not well
            formed; no object is large enough.
    """
    folder = Path(folder)
    if not 0 <= smallest_share < 1:
        raise ValueError(f"smallest_share is {smallest_share}; expected 0 or more and below 1")
    found = find_stills(folder, format)
    stills = [still for known, path in found for still in known.read(path, smallest_share)]
    if not stills:
        names = " and ".join(dict.fromkeys(known.name for known, _ in found))
        raise ValueError(
            f"{folder} ({names}) has no object of {smallest_share:.2%} of its picture or more; "
            "smaller ones lack the detail to be tracked. Lower smallest_share to use them"
        )
    return stills


def find_stills(folder: str | Path, format: str | None = None) -> list[tuple[StillFormat, Path]]:
    """The formats of pictures in a folder, each with the folder it begins at.

    Where the folder itself looks like none, but folders below do, each is taken for what it looks
    like. A folder of images that nothing tells about comes last. Raises as `read_stills` does.
    """
    folder = Path(folder)
    if not folder.exists():
        raise FileNotFoundError(f"{folder} does not exist; expected a folder of pictures")
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder} is not a folder; expected one of pictures")
    if format is not None:
        named = _named(format)
        if found := list(_found_below(folder, (named,))):
            return found
        raise ValueError(f"{folder} holds nothing in the format {named.name}: {named.layout}")
    if found := list(_found_below(folder, ANNOTATED)):
        return found
    if PLAIN.detect(folder):
        return [(PLAIN, folder)]
    looked_for = "".join(f"\n  {known.name}: {known.layout}" for known in STILL_FORMATS)
    raise ValueError(f"{folder} holds no pictures in a known format; expected one of{looked_for}")


def find_here(folder: Path, formats: tuple[StillFormat, ...] = ANNOTATED) -> StillFormat | None:
    """The format that a folder by itself looks like, None where it looks like none.

    Raises:
        ValueError: it looks like several.
    """
    fitting = [known for known in formats if known.detect(folder)]
    if INDEX in fitting:
        return INDEX
    if len(fitting) > 1:
        raise ValueError(
            f"{folder} looks like {' and '.join(known.name for known in fitting)}; name the format "
            "to read it in, or give the folder of one dataset"
        )
    return fitting[0] if fitting else None


def _found_below(
    folder: Path, formats: tuple[StillFormat, ...], above: frozenset[Path] = frozenset()
) -> Iterator[tuple[StillFormat, Path]]:
    """The folder, or those below it, that look like a format, none inside another.

    Args:
        folder: where to begin.
        formats: to look for.
        above: folders that led here, resolved: a link may lead back to one.
    """
    if (found := find_here(folder, formats)) is not None:
        yield found, folder
        return
    above |= {folder.resolve()}
    for path in subfolders(folder):
        if path.resolve() not in above:
            yield from _found_below(path, formats, above)


def notes_of(stills: Iterable[Still]) -> list[str]:
    """What was put right in the annotations of some stills, in a sentence or none: how often, and
    the first of it."""
    notes = [note for still in stills for note in still.notes]
    if not notes:
        return []
    more = "" if len(notes) == 1 else f"{len(notes)} annotations were put right, the first: "
    return [more + notes[0]]


def _named(name: str) -> StillFormat:
    for known in STILL_FORMATS:
        if known.name == name:
            return known
    names = ", ".join(known.name for known in STILL_FORMATS)
    raise ValueError(f"no format of stills is called {name!r}; expected one of {names}")
