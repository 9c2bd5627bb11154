"""What the server allows, all in one place; every refusal names the option that sets it."""

from __future__ import annotations

from dataclasses import dataclass

MEGABYTE = 1_000_000

PICTURE_BYTES = 32 << 20
"""Of one picture of a camera, over REST and WebSocket."""


class OverLimitError(ValueError):
    """Something is larger, longer or more than the server allows.

    Attributes:
        kind: the field of `Limits`.
    """

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


@dataclass(frozen=True)
class Limits:
    """Limits of the server.

    Attributes:
        upload_mb: of a video file, or of the pictures of a camera, in millions of bytes.
        duration_s: of a video, in seconds.
        width, height: of a frame, either way round.
        sessions: kept at once.
        objects: of a session.
        idle_minutes: a session that nobody has used for so long is removed.
    """

    upload_mb: float = 500
    duration_s: float = 600
    width: int = 3840
    height: int = 2160
    sessions: int = 4
    objects: int = 16
    idle_minutes: float = 30

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ValueError(f"limit {name} is {value}; expected more than 0")

    @property
    def upload_bytes(self) -> int:
        """`upload_mb` in bytes."""
        return int(self.upload_mb * MEGABYTE)

    def check_upload(self, size: int) -> None:
        """Raises OverLimitError for more bytes than allowed."""
        if size > self.upload_bytes:
            raise OverLimitError(
                "upload_mb",
                f"the video has more than {self.upload_mb:g} MB, the most that this server takes; "
                "shorten it or make it smaller, or start the server with a larger --max-upload",
            )

    def check_picture(self, size: int) -> None:
        """Raises OverLimitError for more bytes than a picture of a camera may have."""
        most = min(PICTURE_BYTES, self.upload_bytes)
        if size > most:
            raise OverLimitError(
                "upload_mb",
                f"the picture has more than {most / MEGABYTE:g} MB, the most that this server "
                "takes; make it smaller",
            )

    def check_duration(self, seconds: float) -> None:
        """Raises OverLimitError for a longer video than allowed."""
        if seconds > self.duration_s:
            raise OverLimitError(
                "duration_s",
                f"the video is {seconds:.0f} seconds long; this server takes "
                f"{self.duration_s:g} at most; shorten it, or start the server with a larger "
                "--max-duration",
            )

    def check_size(self, width: int, height: int) -> None:
        """Raises OverLimitError for a larger frame than allowed."""
        longer, shorter = max(self.width, self.height), min(self.width, self.height)
        if max(width, height) > longer or min(width, height) > shorter:
            raise OverLimitError(
                "resolution",
                f"frames are {width} x {height} pixels; this server takes {longer} x {shorter} at "
                "most; scale the video down, or start the server with a larger --max-resolution",
            )

    def check_sessions(self, others: int) -> None:
        """Raises OverLimitError where there are already as many as allowed."""
        if others >= self.sessions:
            raise OverLimitError(
                "sessions",
                f"{others} sessions are open, the most that this server keeps at once; close the "
                "page of one and try again in a minute, or start the server with a larger "
                "--max-sessions",
            )

    def check_objects(self, others: int) -> None:
        """Raises OverLimitError where there are already as many as allowed."""
        if others >= self.objects:
            raise OverLimitError(
                "objects",
                f"the session has {others} objects, the most that this server follows in one; "
                "remove one, or start the server with a larger --max-objects",
            )
