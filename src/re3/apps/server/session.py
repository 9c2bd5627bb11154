"""A session: one video, what is followed in it, and the pages that look at it."""

from __future__ import annotations

import asyncio
import secrets
import shutil
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

from re3.apps.server.limits import Limits, OverLimitError
from re3.apps.server.messages import frame_message, jpeg, video_message
from re3.apps.server.recording import Recording
from re3.apps.server.remote_video import RemoteVideo
from re3.apps.server.tracked_video import TrackedVideo
from re3.apps.server.viewer import Viewer
from re3.apps.server.wire import Head
from re3.engine import Engine
from re3.tracker import MultiTracker
from re3.video import SourceError

Source = Literal["sample", "upload", "camera", "select"]
T = TypeVar("T")

AS_FAST_AS_POSSIBLE = 0.0
LATE = 0.5
"""Seconds behind the video's own pace after which the lost time is given up, not made up for."""


class NotReadyError(RuntimeError):
    """The session has no video yet, or not the kind asked for."""


class Session:
    """Everything about one video. All methods belong to the event loop's thread.

    The work is done in a thread of the session's own, one thing after the other.

    Args:
        source: where its frames come from.
        title: for people.
        folder: its own, private; removed at the end.
        engine: shared by all sessions, which it does not change.
        limits: of the server.

    Attributes:
        id: not to be guessed.
        tracked: the video, once there is one.
        path: of the video file, or folder of pictures.
        playing: whether it goes forward by itself.
        ended: whether it has come to the video's end by itself.
        chosen: set when the boxes are drawn that `re3 track --select` waits for.
        viewers: the pages that look at it.
    """

    def __init__(
        self, source: Source, title: str, folder: Path, engine: Engine, limits: Limits
    ) -> None:
        self.id = secrets.token_urlsafe(16)
        self.source: Source = source
        self.title = title
        self.tracked: TrackedVideo | None = None
        self.path: Path | None = None
        self.playing = False
        self.ended = False
        self.chosen = asyncio.Event()
        self.viewers: set[Viewer] = set()
        self.used_at = time.monotonic()
        self._folder, self._engine, self._limits = folder / self.id, engine, limits
        self._folder.mkdir(mode=0o700)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="session")
        self._lock = asyncio.Lock()
        self._player: asyncio.Task[None] | None = None
        self._video: RemoteVideo | Recording | None = None
        self._waiting: deque[tuple[bytes, float, Viewer | None, int]] = deque()
        self._camera_task: asyncio.Task[None] | None = None
        self._camera_started = 0.0
        self._closed = False

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return self._folder

    @property
    def busy(self) -> bool:
        """Whether it plays, or its video is being uploaded."""
        return self.playing or (self.path is not None and self.tracked is None)

    @property
    def fps(self) -> Fraction:
        """Frames a second of the video."""
        return self._video.fps if self._video is not None else Fraction(30)

    @property
    def video(self) -> TrackedVideo:
        """The video; raises NotReadyError where there is none yet."""
        if self.tracked is None:
            raise NotReadyError(
                "the session has no video yet; upload one (PUT .../video), or send frames of a "
                "camera (POST .../frames)"
            )
        return self.tracked

    def use(self) -> None:
        """Note that somebody uses it."""
        self.used_at = time.monotonic()

    async def open(self, path: Path) -> None:
        """Begin with a video file.

        Raises:
            SourceError, OverLimitError: it cannot be used.
        """
        self.tracked = await self.run(partial(self._open, path))
        self.path = path
        self.tell_state()

    async def run(self, work: Callable[[], T]) -> T:
        """Do work in the session's thread; raises NotReadyError after `close`."""
        if self._closed:
            raise NotReadyError("the session has ended")
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    async def change(self, change: Callable[[TrackedVideo], T]) -> T:
        """Stop where it is, do something, and show what came of it."""
        self.use()
        async with self._lock:
            video = self.video
            await self._stop()
            self.ended = False
            done = await self.run(partial(change, video))
            self.tell_state()
            await self.show()
        return done

    async def play(self, speed: float = 1.0, until: int | None = None) -> None:
        """Go forward by itself.

        Args:
            speed: times the video's own; 0 for as fast as possible.
            until: the frame to stop at.
        """
        self.use()
        async with self._lock:
            video = self.video
            await self._stop()
            self.playing, self.ended = True, False
            self._player = asyncio.create_task(self._play(video, speed, until))
            self.tell_state()

    async def pause(self) -> None:
        """Stop where it is."""
        self.use()
        async with self._lock:
            await self._stop()
            self.tell_state()
            await self.show()

    async def seek(self, index: int) -> None:
        """Go to a frame; where others have to be tracked first, set out for it."""
        near = self.video.last_shown_before(max(0, index))
        await self.change(lambda video: video.show(near))
        if near < index:
            await self.play(AS_FAST_AS_POSSIBLE, index)

    async def finish_playing(self) -> None:
        """Wait until it has stopped by itself."""
        if self._player is not None:
            with suppress(asyncio.CancelledError):
                await self._player

    def offer_picture(self, picture: bytes, viewer: Viewer | None = None) -> int:
        """Take a picture of the camera; of those that wait, only the newest is kept.

        Returns:
            its number, counted by viewer.
        """
        self.use()
        number = viewer.frames_received if viewer is not None else 0
        if viewer is not None:
            viewer.frames_received += 1
        while self._waiting:
            _, _, other, dropped = self._waiting.popleft()
            if other is not None:
                other.tell({"type": "dropped", "number": dropped})
        self._waiting.append((picture, time.monotonic(), viewer, number))
        if self._camera_task is None or self._camera_task.done():
            self._camera_task = asyncio.create_task(self._take_pictures())
        return number

    async def take_picture(self, picture: bytes, at: float | None = None) -> None:
        """Track into a picture of the camera.

        Raises:
            SourceError, OverLimitError: it cannot be used.
        """
        self.use()
        if self.source != "camera":
            raise NotReadyError("frames can be sent to a session of source 'camera' only")
        async with self._lock:
            await self._stop()
            now = time.monotonic() if at is None else at
            await self.run(partial(self._take, picture, now))

    async def show(self, but: Viewer | None = None, extra: Head | None = None) -> None:
        """Tell the pages of the frame shown, with its picture for those that are ready.

        Args:
            but: a page that has the picture itself.
            extra: to be told to that page.
        """
        if self.tracked is None or not self.viewers:
            return
        head, frame = frame_message(self.tracked, self.tracked.position), self.tracked.frame
        ready = [each for each in self.viewers if each.ready and each is not but]
        picture = await self.run(partial(jpeg, frame)) if ready else None
        for each in self.viewers:
            if each in ready:
                each.tell(head, picture)
            elif each is but:
                each.tell({**head, **(extra or {})})
            else:
                each.owed = True
                each.tell(head)

    async def catch_up(self, viewer: Viewer) -> None:
        """Send the page the picture that it is owed."""
        if viewer.owed and viewer.ready and self.tracked is not None:
            viewer.owed = False
            head, frame = frame_message(self.tracked, self.tracked.position), self.tracked.frame
            viewer.tell(head, await self.run(partial(jpeg, frame)))

    def tell_state(self) -> None:
        """Tell all pages how things are."""
        for viewer in self.viewers:
            viewer.tell({"type": "state", "session": self.state()})

    def state(self) -> Head:
        """How things are, as the API says it."""
        told: Head = {
            "id": self.id,
            "source": self.source,
            "title": self.title,
            "ready": self.tracked is not None,
            "playing": self.playing,
            "ended": self.ended,
            "fps": float(self.fps),
        }
        return told if self.tracked is None else told | video_message(self.tracked)

    async def close(self) -> None:
        """Stop, let go of the decoder, and remove all files."""
        self.playing, self._closed = False, True
        for task in (self._player, self._camera_task):
            if task is not None:
                task.cancel()
        if self._video is not None:
            decoder = self._video.video if isinstance(self._video, Recording) else self._video
            decoder.close()
        self._thread.shutdown(wait=False, cancel_futures=True)
        shutil.rmtree(self._folder, ignore_errors=True)

    def _open(self, path: Path) -> TrackedVideo:
        self._video = video = RemoteVideo(self._limits)
        video.open(path)
        return TrackedVideo(video, MultiTracker(engine=self._engine), self._limits)

    async def _stop(self) -> None:
        self.playing = False
        if self._player is not None:
            await self._player
            self._player = None

    async def _play(self, video: TrackedVideo, speed: float, until: int | None) -> None:
        loop = asyncio.get_running_loop()
        due, before = loop.time(), video.frame.timestamp
        try:
            while self.playing and (until is None or video.position < until):
                if not await self.run(video.forward):
                    self.ended = True
                    return
                self.use()
                await self.show()
                if speed > 0:
                    due += (video.frame.timestamp - before) / speed
                    before = video.frame.timestamp
                    if loop.time() - due > LATE:
                        due = loop.time()
                # At the least once, so that others get their turn.
                await asyncio.sleep(max(0.0, due - loop.time()) if speed > 0 else 0)
        except SourceError as error:
            video.broken = str(error)
        finally:
            self.playing = False
            self.tell_state()
            for viewer in list(self.viewers):
                await self.catch_up(viewer)

    async def _take_pictures(self) -> None:
        while self._waiting:
            picture, at, viewer, number = self._waiting.popleft()
            first = self.tracked is None
            try:
                await self.take_picture(picture, at)
            except (ValueError, NotReadyError) as error:
                if viewer is not None:
                    kind = error.kind if isinstance(error, OverLimitError) else None
                    viewer.tell(
                        {"type": "refused", "number": number, "error": str(error), "limit": kind}
                    )
                continue
            if first:
                self.tell_state()
            waited = round(1000 * (time.monotonic() - at), 1)
            await self.show(viewer, {"number": number, "server_ms": waited})

    def _take(self, picture: bytes, now: float) -> None:
        if self._video is None:
            pictures = self._folder / "pictures"
            pictures.mkdir()
            self._video, self.path = Recording(pictures, self._limits), pictures
        recording = self._video
        assert isinstance(recording, Recording)
        if not recording.timestamps:
            self._camera_started = now
        index = recording.append(picture, now - self._camera_started)
        if self.tracked is None:
            tracker = MultiTracker(engine=self._engine)
            self.tracked = TrackedVideo(recording, tracker, self._limits)
            return
        self.tracked.show(self.tracked.last_shown_before(index))
        while self.tracked.position < index and self.tracked.forward():
            pass
