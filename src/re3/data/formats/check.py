"""Look a dataset over without tracking anything: what is in it, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from re3.data.formats import find_format
from re3.data.formats.files import Entry
from re3.data.sequence import Sequence
from re3.video import open_source
from re3.video.images import sorted_images


@dataclass(frozen=True)
class Finding:
    """What there is to say about a sequence, or about a clip that cannot be read.

    Attributes:
        name, dataset: of the sequence.
        frames: T, with or without a box.
        boxes: frames with a box.
        gaps: frames without one.
        occluded: frames marked as occluded; None where the dataset marks nothing.
        median_size: median width and height in pixels; None without a box.
        attributes: of the sequence.
        errors: what makes it unusable.
        warnings: what looks odd.
    """

    name: str
    dataset: str = ""
    frames: int = 0
    boxes: int = 0
    gaps: int = 0
    occluded: int | None = None
    median_size: tuple[float, float] | None = None
    attributes: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Source:
    """What a source of frames turned out to be.

    Attributes:
        size: width and height of its first frame; None where that cannot be read.
        count: frames in it, where that is known for certain.
        announced: frames in it as a video file says, which may be an estimate.
        broken: index of a frame -> why it cannot be read; -1 of the source as a whole.
    """

    size: tuple[int, int] | None
    count: int | None
    broken: dict[int, str]
    announced: int | None = None


def check_dataset(
    folder: Path,
    format: str | None = None,
    *,
    decode: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[str, list[Finding]]:
    """Read a dataset clip by clip and look for what is wrong.

    A broken clip becomes a finding with its error, and the rest is read all the same.

    Args:
        folder: of the dataset.
        format: its name; by default it is detected.
        decode: also decode every frame. Without, one frame of each source is, for its size.
        on_progress: called after each clip with the number done and the number in all.

    Returns:
        the name of the format, and the findings in the order of the dataset.

    Raises:
        ValueError, OSError: the folder as a whole is no dataset; see `read_dataset`.
    """
    known = find_format(folder, format)
    entries = known.clips(folder)
    findings: list[Finding] = []
    # Tracks, and the parts of a long video, share frames, which are looked at once.
    sources: dict[Path, _Source] = {}
    for done, entry in enumerate(entries, start=1):
        findings.extend(_check_clip(entry, decode, sources))
        if on_progress is not None:
            on_progress(done, len(entries))
    return known.name, findings


def _check_clip(entry: Entry, decode: bool, sources: dict[Path, _Source]) -> Iterator[Finding]:
    try:
        sequences = entry.read()
    except (ValueError, OSError) as error:
        yield Finding(entry.name, errors=(str(error),))
        return
    if not sequences:
        yield Finding(entry.name, errors=("no object with a box",))
    for sequence in sequences:
        if sequence.source not in sources:
            sources[sequence.source] = _look_at(sequence.source, decode)
        if _is_to_be_counted(sequence, sources[sequence.source]):
            sources[sequence.source] = _look_at(sequence.source, decode=True)
        yield _check_sequence(sequence, sources[sequence.source])


def _is_to_be_counted(sequence: Sequence, source: _Source) -> bool:
    """Whether the frames of a video have to be decoded to know how many there are: where what the
    file says is not what the annotation says."""
    end = sequence.start_frame + len(sequence)
    if source.count is not None or source.broken:
        return False
    if source.announced is None:
        return True
    return source.announced != end if sequence.row_a_frame else source.announced < end


def _check_sequence(sequence: Sequence, source: _Source) -> Finding:
    annotated = sequence.annotated
    boxes = int(annotated.sum())
    end = sequence.start_frame + len(sequence)
    errors = [why for t, why in source.broken.items() if t == -1 or sequence.start_frame <= t < end]
    warnings = []
    if source.count is not None and source.count < end:
        errors.append(
            f"{source.count} frames in {sequence.source}, but boxes for {end}; expected as many: "
            "is the annotation that of another clip?"
        )
    elif source.count is not None and sequence.row_a_frame and source.count > end:
        warnings.append(
            f"boxes for {end} of {source.count} frames; expected a line a frame, nan,nan,nan,nan "
            "where the object is absent"
        )
    if not boxes:
        errors.append("no frame has a box")
    sizes = sequence.boxes_xywh[annotated, 2:]
    width, height = np.median(sizes, axis=0) if boxes else (0.0, 0.0)
    return Finding(
        name=sequence.name,
        dataset=sequence.dataset,
        frames=len(sequence),
        boxes=boxes,
        gaps=len(sequence) - boxes,
        occluded=None if sequence.occluded is None else int(sequence.occluded.sum()),
        median_size=(float(width), float(height)) if boxes else None,
        attributes=sequence.attributes,
        errors=tuple(errors),
        warnings=(*warnings, *sequence.problems(source.size)),
    )


def _look_at(path: Path, decode: bool) -> _Source:
    try:
        with open_source(path, skip_broken=False) as source:
            size = source.size
            # What a video file says of its length may be an estimate.
            count = source.frame_count if path.is_dir() else None
            announced = None if path.is_dir() else source.frame_count
            if decode and not path.is_dir():
                return _walk(size, iter(source))
    except (ValueError, OSError) as error:
        if not (decode and path.is_dir()):
            return _Source(None, None, {-1: str(error)})
        size, count, announced = None, None, None
    return (
        _decode_images(path, size)
        if decode and path.is_dir()
        else _Source(size, count, {}, announced)
    )


def _walk(size: tuple[int, int], frames: Iterator[object]) -> _Source:
    """Decode a video to its end, or to where it breaks."""
    count = 0
    try:
        for _ in frames:
            count += 1
    except (ValueError, OSError) as error:
        return _Source(size, None, {count: str(error)})
    return _Source(size, count, {})


def _decode_images(folder: Path, size: tuple[int, int] | None) -> _Source:
    """Decode every image of a folder; one that is broken does not end it."""
    images = sorted_images(folder.iterdir())
    broken: dict[int, str] = {}
    for index, path in enumerate(images):
        try:
            with open_source(path) as source:
                size = size or source.size
        except (ValueError, OSError) as error:
            broken[index] = str(error)
    if not images:
        broken[-1] = f"{folder} holds no image"
    return _Source(size, len(images), broken)
