"""TrackingNet: chunks `TRAIN_0` to `TRAIN_11` and `TEST` with `frames/<video>/` and `anno/`.

Müller et al.: TrackingNet, ECCV 2018. The folder of one chunk is a dataset as well. Images are
`0.jpg` and on, boxes `x,y,width,height` a line in `anno/<video>.txt`, 0-based. Most boxes were
made by trackers between hand-drawn ones a second apart; they reach past the edge at times, and
nothing tells the two kinds apart. Videos of `TEST` give away the first box alone.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from re3.data.formats.files import (
    Entry,
    check_count,
    dataset_name,
    files_with,
    images_in,
    pad_to_images,
    subfolders,
    truth_of,
)
from re3.data.sequence import Sequence

LAYOUT = "frames/<video>/ and anno/<video>.txt, or folders with them such as TRAIN_0/"


def detect(folder: Path) -> bool:
    """Whether the folder, or one in it, has `frames/` and texts in `anno/`."""
    return bool(_chunks(folder))


def entries(folder: Path) -> list[Entry]:
    """The videos that have an annotation, chunk by chunk."""
    return [
        Entry(text.stem, partial(_read, text, chunk / "frames" / text.stem, dataset_name(chunk)))
        for chunk in _chunks(folder)
        for text in files_with(chunk / "anno", ".txt")
    ]


def _chunks(folder: Path) -> list[Path]:
    return [
        path
        for path in [folder, *subfolders(folder)]
        if (path / "frames").is_dir() and files_with(path / "anno", ".txt")
    ]


def _read(text: Path, source: Path, dataset: str) -> list[Sequence]:
    images = len(images_in(source))
    boxes = pad_to_images(truth_of(text, first_pixel=0), images)
    check_count(len(boxes), text, images, source)
    return [Sequence(name=text.stem, source=source, boxes_xywh=boxes, dataset=dataset)]
