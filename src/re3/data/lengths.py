"""Whether annotations have as many rows as their clips have frames."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from re3.data.sequence import Sequence
from re3.video import open_source


def frame_count(source: Path, expected: int) -> int:
    """Frames of a source, at least one.

    Args:
        source: a video file or a folder of images.
        expected: what a video file says of its length is believed where it says this; else it is
            decoded and its frames are counted.

    Raises:
        ValueError: it cannot be read (`re3.video.SourceError`).
    """
    with open_source(source) as frames:
        if frames.frame_count is not None and (source.is_dir() or frames.frame_count == expected):
            return frames.frame_count
        return sum(1 for _ in frames)


def check_lengths(sequences: Iterable[Sequence]) -> None:
    """Refuse annotations that end before their clips do, where their form has a row a frame.

    Figures over the frames that have a row would look like figures over the clip. Those with more
    rows than frames, and clips that cannot be read, are left to whoever reads the frames.

    Raises:
        ValueError: there are some; names the first and counts them.
    """
    short = []
    for sequence in sequences:
        if not sequence.row_a_frame:
            continue
        rows = sequence.start_frame + len(sequence)
        try:
            frames = frame_count(sequence.source, rows)
        except (ValueError, OSError):
            continue
        if frames > rows:
            short.append(f"{sequence.name} has {rows} boxes for {frames} frames")
    if short:
        others = f" (and {len(short) - 1} more)" if len(short) > 1 else ""
        raise ValueError(
            f"{short[0]}{others}; expected a line a frame, nan,nan,nan,nan where the object is "
            "absent: is the annotation that of another clip? To score the frames that have a line, "
            "give --short-truth"
        )
