"""Readers of data sets in the layouts they are published in.

A module a format; each has `detect(folder)`, which looks at the structure and never at the
folder's own name, and `entries(folder)`, which finds the clips without reading them. What all of
them give are sequences with 0-based boxes, NaN where there is none; see `docs/datasets.md`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from re3.data.formats import (
    alov,
    davis,
    got10k,
    imagenet_vid,
    lasot,
    motchallenge,
    otb,
    plain_form,
    trackingnet,
    uav123,
    visdrone,
    vot,
)
from re3.data.formats.files import Entry, subfolders
from re3.data.sequence import Sequence


@dataclass(frozen=True)
class Format:
    """A layout of a dataset on disk.

    Attributes:
        name: what a user calls it.
        layout: what a folder has to look like, in a line.
        detect: whether a folder looks like it.
        entries: the clips in a folder, not read yet.
        automatic: whether it is tried on a folder of unknown format; False for a format that
            reads the same files as another does, in another way.
        training: whether it is tried on a folder of unknown format that is to be trained on; None
            where that is as for `automatic`.
    """

    name: str
    layout: str
    detect: Callable[[Path], bool]
    entries: Callable[[Path], list[Entry]]
    automatic: bool = True
    training: bool | None = None

    def read(self, folder: str | Path) -> list[Sequence]:
        """Read every clip.

        Raises:
            ValueError, OSError: no clip, or one that is broken; the message names the file.
        """
        return [sequence for entry in self.clips(folder) for sequence in entry.read()]

    def clips(self, folder: str | Path) -> list[Entry]:
        """The clips in a folder, at least one.

        Raises:
            NotADirectoryError, FileNotFoundError: no such folder.
            ValueError: no clip in it.
        """
        folder = _existing(folder)
        if entries := self.entries(folder):
            return entries
        raise ValueError(f"{folder} holds no clip in the format {self.name}: {self.layout}")


FORMATS = (
    Format("otb", otb.LAYOUT, otb.detect, otb.entries),
    Format("vot", vot.LAYOUT, vot.detect, vot.entries),
    Format("got10k", got10k.LAYOUT, got10k.detect, got10k.entries),
    Format("lasot", lasot.LAYOUT, lasot.detect, lasot.entries),
    Format("uav123", uav123.LAYOUT, uav123.detect, uav123.entries),
    # A frame without a box is one without the object to training: it takes interpolated ones.
    Format("alov", alov.LAYOUT, alov.detect, alov.entries, training=False),
    Format(
        "alov-interpolated",
        f"{alov.LAYOUT}; boxes between the annotated frames are interpolated",
        alov.detect,
        partial(alov.entries, interpolate=True),
        automatic=False,
        training=True,
    ),
    Format("imagenet-vid", imagenet_vid.LAYOUT, imagenet_vid.detect, imagenet_vid.entries),
    Format(
        "imagenet-vid-drawn",
        f"{imagenet_vid.LAYOUT}; boxes marked as generated are left out",
        imagenet_vid.detect,
        partial(imagenet_vid.entries, generated=False),
        automatic=False,
    ),
    Format("trackingnet", trackingnet.LAYOUT, trackingnet.detect, trackingnet.entries),
    Format("davis", davis.LAYOUT, davis.detect, davis.entries),
    Format(
        "davis-merged",
        f"{davis.LAYOUT}; all ids of a clip are one object",
        davis.detect,
        partial(davis.entries, merge=True),
        automatic=False,
    ),
    Format("motchallenge", motchallenge.LAYOUT, motchallenge.detect, motchallenge.entries),
    Format("visdrone", visdrone.LAYOUT, visdrone.detect, visdrone.entries),
    # Last: it takes any folder with an annotated clip somewhere below.
    Format("plain", plain_form.LAYOUT, plain_form.detect, plain_form.entries),
)


def read_dataset(
    folder: str | Path, format: str | None = None, *, training: bool = False
) -> list[Sequence]:
    """Read a dataset in any of the known formats, or several in the folders below.

    Args:
        folder: the dataset's folder, as it is unpacked, or one somewhere above it.
        format: the name of one of `FORMATS`; by default the one the folder looks like.
        training: it is to be trained on: the variant that suits that is taken where the format is
            not named, and sequences that are known to occur in a benchmark are left out.

    Raises:
        NotADirectoryError, FileNotFoundError: no such folder, or a file of it is missing.
        ValueError: no such format; a folder looks like none or like several; a file is not well
            formed (the message names it, and the line).
    """
    sequences = find_format(folder, format, training=training).read(folder)
    if training:
        return [sequence for sequence in sequences if sequence.name not in alov.IN_VOT2014]
    return sequences


def find_format(folder: str | Path, format: str | None = None, *, training: bool = False) -> Format:
    """The format named, or the one a folder looks like.

    Where the folder itself looks like none, but folders below it do, each is read as what it
    looks like, with the plain clips that lie in none of them; the name of what is returned lists
    the formats. Raises as `read_dataset` does.
    """
    folder = _existing(folder)
    *special, plain = _tried(training)
    if format is not None:
        named = _named(format)
        found = list(_datasets(folder, [named]))
        # Without any, the reader says what it misses.
        return _several(found) if found and found[0][1] != folder else named
    found = list(_datasets(folder, special))
    if found and found[0][1] == folder:
        return found[0][0]
    clips = partial(plain_form.entries, without={path for _, path in found})
    if clips(folder):
        if not found:
            return plain
        found.append((replace(plain, entries=clips), folder))
    if found:
        return _several(found)
    looked_for = "".join(f"\n  {known.name}: {known.layout}" for known in (*special, plain))
    raise ValueError(
        f"{folder} holds no annotated clip in a known format; expected one of{looked_for}"
    )


def looks_like_clips(folder: Path) -> bool:
    """Whether a folder by itself looks like a dataset of sequences in a format but the plain."""
    return any(known.detect(folder) for known in _tried(training=True)[:-1])


def _tried(training: bool) -> list[Format]:
    """The formats that a folder is tried for, the plain one last."""
    return [
        known
        for known in FORMATS
        if (known.automatic if not training or known.training is None else known.training)
    ]


def _datasets(
    folder: Path, formats: list[Format], above: frozenset[Path] = frozenset()
) -> Iterator[tuple[Format, Path]]:
    """The folder, or those below it, that look like one of the formats, none inside another.

    Args:
        folder: where to begin.
        formats: to look for.
        above: folders that led here, resolved: a link may lead back to one.
    """
    fitting = [known for known in formats if known.detect(folder)]
    if len(fitting) > 1:
        raise ValueError(
            f"{folder} looks like {' and '.join(known.name for known in fitting)}; name the format "
            "to read it in, or give the folder of one dataset"
        )
    if fitting:
        yield fitting[0], folder
        return
    above |= {folder.resolve()}
    for path in subfolders(folder):
        if path.resolve() not in above:
            yield from _datasets(path, formats, above)


def _several(found: list[tuple[Format, Path]]) -> Format:
    """What reads each of some folders in its own format."""
    formats = list({known.name: known for known, _ in found}.values())

    def entries(_: Path) -> list[Entry]:
        return [entry for known, path in found for entry in known.entries(path)]

    return Format(
        name=" and ".join(known.name for known in formats),
        layout="; or ".join(known.layout for known in formats),
        detect=lambda _: True,
        entries=entries,
    )


def _named(name: str) -> Format:
    for known in FORMATS:
        if known.name == name:
            return known
    names = ", ".join(known.name for known in FORMATS)
    raise ValueError(f"no format is called {name!r}; expected one of {names}")


def _existing(folder: str | Path) -> Path:
    folder = Path(folder)
    if not folder.exists():
        raise FileNotFoundError(f"{folder} does not exist; expected the folder of a dataset")
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder} is not a folder; expected that of a dataset")
    return folder
