"""Pictures of a camera, kept as they come in, so that one can go back in them."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from re3.apps.server.limits import Limits
from re3.apps.server.remote_video import RemoteVideo
from re3.video import Frame, SourceError

ENDING = ".jpg"
"""Of all files, whatever the picture is: readers go by the content."""


class Recording:
    """A video that grows by pictures; `re3.apps.server.tracked_video.Video`.

    Args:
        folder: empty; the pictures go there.
        limits: of the server.

    Attributes:
        video: the decoder.
        timestamps: of the frames, seconds from the first.
        frame_count: so far.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self.video = RemoteVideo(limits)
        self.timestamps: list[float] = []
        self._folder, self._limits = folder, limits
        self._bytes = 0

    @property
    def frame_count(self) -> int | None:
        """So far."""
        return len(self.timestamps)

    @property
    def fps(self) -> Fraction:
        """Frames a second on average."""
        if len(self.timestamps) < 2:
            return Fraction(30)
        return Fraction(len(self.timestamps) - 1) / Fraction(max(self.timestamps[-1], 1e-3))

    def append(self, picture: bytes, timestamp: float) -> int:
        """Add a picture (JPEG, PNG or WebP); its index.

        Raises:
            SourceError: it cannot be read; the recording stays as it was.
            OverLimitError: the recording or the picture is too large, or the recording too long.
            OSError: it cannot be written; the recording stays as it was.
        """
        self._limits.check_upload(self._bytes + len(picture))
        self._limits.check_duration(timestamp)
        index = len(self.timestamps)
        path = self._folder / f"{index:08d}{ENDING}"
        try:
            path.write_bytes(picture)
            if index == 0:
                self.video.open(self._folder, pictures=True)
            elif self.video.read(index) is None:
                raise SourceError("the picture cannot be read")
        except (ValueError, OSError):
            path.unlink(missing_ok=True)
            raise
        self.timestamps.append(timestamp)
        self._bytes += len(picture)
        return index

    def read(self, index: int) -> Frame | None:
        """See `RemoteVideo.read`."""
        if index >= len(self.timestamps):
            return None
        frame = self.video.read(index)
        return frame and replace(frame, timestamp=self.timestamps[index])
