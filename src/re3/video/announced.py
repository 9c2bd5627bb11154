"""What a container says of its own length, and whether it kept that."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction

import av

TOLERATED_FRAMES = 2
TOLERATED_SHARE = 0.02
"""Files cut to length announce a few frames more than they give."""


@dataclass(frozen=True, slots=True)
class Announced:
    """The length that a container announces.

    Attributes:
        frames: as counted by the container, else estimated from the duration; None of a live
            stream.
        counted: whether the container counted them.
        seconds: duration of the video track, else of the whole file; None where it is not known.
        certain: whether that is the length of the video, not of a sound track beside it.
    """

    frames: int | None
    counted: bool
    seconds: float | None
    certain: bool

    @classmethod
    def by(
        cls, container: av.container.InputContainer, stream: av.VideoStream, fps: Fraction
    ) -> Announced:
        """Read it from the headers."""
        seconds, certain = _track_seconds(stream), True
        if seconds is None and container.duration is not None:
            seconds = container.duration / av.time_base
            certain = len(container.streams) == 1
        if stream.frames:
            # In MP4 an edit list may leave out frames that are counted: the duration knows that.
            # In AVI the duration is an estimate from the size of the file.
            edited = "mp4" in container.format.name
            return cls(stream.frames, True, seconds if edited else None, True)
        frames = None if seconds is None else max(1, round(seconds * fps))
        return cls(frames, False, seconds, certain)

    def missing(self, given: int, last_timestamp: float, fps: Fraction) -> int:
        """Frames that the container announced and did not give.

        Frames that were not counted are compared by time, as the rate may vary. Differences too
        small to mean anything are 0.

        Args:
            given: frames decoded, and those that could not be.
            last_timestamp: of the last of them, in seconds.
            fps: frames a second.
        """
        found = []
        if self.counted and self.frames is not None:
            found.append(self.frames - given)
        if self.seconds is not None:
            found.append(round((self.seconds - last_timestamp) * fps) - 1)
        missing = min(found, default=0)
        return missing if missing > max(TOLERATED_FRAMES, TOLERATED_SHARE * given) else 0


def _track_seconds(stream: av.VideoStream) -> float | None:
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    # Matroska has the duration of a track as a tag.
    tag = re.fullmatch(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)", stream.metadata.get("DURATION", ""))
    return None if tag is None else 3600 * int(tag[1]) + 60 * int(tag[2]) + float(tag[3])
