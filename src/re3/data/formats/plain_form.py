"""The plain form as a format among the others; see `re3.data.plain`."""

from __future__ import annotations

from collections.abc import Container
from functools import partial
from pathlib import Path

from re3.data.formats.files import Entry
from re3.data.plain import annotated_clips, clip_name, read_clip

LAYOUT = "videos or folders of images, each with a .txt or .jsonl of the same name beside it"


def detect(folder: Path) -> bool:
    """Whether there is an annotated clip in the folder or below it."""
    return bool(annotated_clips(folder))


def entries(folder: Path, without: Container[Path] = ()) -> list[Entry]:
    """The annotated clips in a folder and below it, in the order of `plain.read_folder`.

    Args:
        folder: to search.
        without: folders in it that are left out, with all below.
    """
    return [
        Entry(clip_name(clip), partial(read_clip, clip, annotation))
        for clip, annotation in annotated_clips(folder)
        if not any(path in without for path in (clip, *clip.parents))
    ]
