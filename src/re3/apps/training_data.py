"""What training, and a look at its data, draws clips from: folders, or a mix in YAML."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from re3.apps.console import stderr
from re3.data.frame_store import DEFAULT_LIMIT_GB

if TYPE_CHECKING:
    from re3.data.sampling import ClipSampler
    from re3.data.sequence import Sequence
    from re3.data.stills import Still

CacheOption = Annotated[
    float,
    typer.Option(
        "--cache-gb",
        help="Disk space, in gigabytes, for decoded frames, in $RE3_CACHE or ~/.cache/re3. What "
        "was used longest ago makes room.",
        metavar="GB",
    ),
]
DEFAULT_CACHE_GB = DEFAULT_LIMIT_GB


def is_mix(path: Path) -> bool:
    """Whether a path is that of a mix rather than of a folder."""
    from re3.data.mix import SUFFIXES

    return path.suffix.lower() in SUFFIXES and not path.is_dir()


def mix_or_folders(
    paths: list[Path],
    exclude: set[str],
    format_name: str | None,
    cache_gb: float = DEFAULT_CACHE_GB,
) -> ClipSampler:
    """What is drawn from one mix, or from folders; raises as the two below do."""
    mixes = [path for path in paths if is_mix(path)]
    if not mixes:
        return folders_sampler(paths, exclude, format_name, cache_gb)
    if len(paths) > 1:
        raise ValueError(f"{mixes[0]} is a mix; expected it alone, or folders without a mix")
    if exclude or format_name is not None:
        raise ValueError(
            f"{mixes[0]} says itself what is left out and in which format it is; write exclude "
            "and format there, not as options"
        )
    return mix_file_sampler(mixes[0], cache_gb)


def mix_file_sampler(path: Path, cache_gb: float = DEFAULT_CACHE_GB) -> ClipSampler:
    """What is drawn from a mix.

    Raises:
        ValueError, OSError, ImportError: the mix or its data cannot be read; see `re3.data.mix`.
    """
    from re3.data.frame_store import FrameStore
    from re3.data.mix import mix_sampler, read_mix

    sampler = mix_sampler(read_mix(path), FrameStore(limit_gb=cache_gb))
    show_notes(sampler.stills)
    return sampler


def show_notes(stills: Iterable[Still]) -> None:
    """Say on stderr what was put right in the annotations of stills."""
    from re3.data.still_formats import notes_of

    for note in notes_of(stills):
        stderr().print(f"note: {note}", markup=False)


def folders_sampler(
    folders: list[Path],
    exclude: set[str],
    format_name: str | None,
    cache_gb: float = DEFAULT_CACHE_GB,
) -> ClipSampler:
    """What is drawn from folders: all sequences and stills in them, datasets weighted by the root
    of their length.

    Args:
        folders: to search.
        exclude: names of datasets that are left out.
        format_name: of the sequences or of the stills; by default what each folder looks like.
        cache_gb: disk space for decoded frames.

    Raises:
        ValueError, OSError: nothing there, or something that cannot be read.
    """
    from re3.data.frame_store import FrameStore
    from re3.data.sampling import ClipSampler

    sequences: list[Sequence] = []
    stills: list[Still] = []
    for folder in folders:
        if not folder.is_dir():
            raise ValueError(f"{folder} is not a folder; expected clips or stills in it")
        found = _find(folder, format_name)
        sequences += found[0]
        stills += found[1]
    show_notes(stills)
    known = {s.dataset for s in sequences} | {still.dataset for still in stills}
    if exclude - known:
        raise ValueError(
            f"no dataset {sorted(exclude - known)} to leave out; there are {sorted(known)}"
        )
    return ClipSampler(
        [sequence for sequence in sequences if sequence.dataset not in exclude],
        [still for still in stills if still.dataset not in exclude],
        FrameStore(limit_gb=cache_gb),
    )


def _find(folder: Path, format_name: str | None) -> tuple[list[Sequence], list[Still]]:
    """The sequences and the stills in a folder and below it."""
    from re3.data.formats import looks_like_clips, read_dataset
    from re3.data.plain import read_clip
    from re3.data.still_formats import read_stills
    from re3.data.still_formats.check import is_still_format, still_folders
    from re3.data.stills import SMALLEST_SHARE

    if is_still_format(format_name):
        return [], read_stills(folder, format_name)
    found = {path: known for known, path in still_folders(folder)}
    stills = [still for path, known in found.items() for still in known.read(path, SMALLEST_SHARE)]
    # ImageNet has videos and stills in one folder.
    only_stills = {path for path in found if not looks_like_clips(path)}
    beside = _clips_beside(folder, only_stills)
    sequences = [
        sequence
        for child in _clip_folders(folder, only_stills | {clip for clip, _ in beside})
        for sequence in read_dataset(child, format_name, training=True)
    ]
    if format_name in (None, "plain"):
        sequences += [s for clip, annotation in beside for s in read_clip(clip, annotation)]
    return sequences, stills


def _clip_folders(folder: Path, known: set[Path]) -> list[Path]:
    """The folders to search for clips: all but those of stills, and of clips, that are known."""
    if folder in known:
        return []
    if not any(folder in path.parents for path in known):
        holds_files = any(path.is_file() for path in folder.rglob("*"))
        return [folder] if holds_files else []
    return [f for c in sorted(folder.iterdir()) if c.is_dir() for f in _clip_folders(c, known)]


def _clips_beside(folder: Path, stills: set[Path]) -> list[tuple[Path, Path]]:
    """Plain clips, with their annotations, that lie directly in a folder which leads to stills."""
    from re3.data.plain import annotated_clips

    leading = {
        path for still in stills for path in still.parents if folder in (path, *path.parents)
    }
    if not leading:
        return []
    return [found for found in annotated_clips(folder) if found[0].parent in leading]
