"""A session: one video, what is followed in it, and the pages that look at it."""

from __future__ import annotations

import asyncio
import secrets
import shutil
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from re3.apps.server.annotation import Change
from re3.apps.server.camera_feed import CameraFeed
from re3.apps.server.limits import Limits
from re3.apps.server.messages import boxes_messages, frame_message, jpeg, video_message
from re3.apps.server.playing import Player
from re3.apps.server.problems import NotReadyError
from re3.apps.server.recording import Recording
from re3.apps.server.remote_video import RemoteVideo
from re3.apps.server.tracked_video import TrackedVideo
from re3.apps.server.viewer import Viewer
from re3.apps.server.wire import Head
from re3.engine import Engine
from re3.tracker import MultiTracker

Source = Literal["sample", "upload", "camera", "select"]
T = TypeVar("T")

AS_FAST_AS_POSSIBLE = 0.0


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
        player: goes forward by itself.
        exporting: held while a file is written: one at a time.
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
        self.player = Player(self.run, self)
        self.exporting = asyncio.Lock()
        self.chosen = asyncio.Event()
        self.viewers: set[Viewer] = set()
        self.used_at = time.monotonic()
        self._folder, self._engine, self._limits = folder / self.id, engine, limits
        self._folder.mkdir(mode=0o700)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="session")
        self._lock = asyncio.Lock()
        self._video: RemoteVideo | Recording | None = None
        self._feed = CameraFeed(self._take_offered)
        self._camera_started = 0.0
        self._tasks: set[asyncio.Task[Any]] = set()
        self._closed = False

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return self._folder

    @property
    def closed(self) -> bool:
        """Whether it has been ended."""
        return self._closed

    @property
    def busy(self) -> bool:
        """Whether its video is being uploaded, or a file of it written."""
        return self.exporting.locked() or (self.path is not None and self.tracked is None)

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

    def start(self, work: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """A task that is cancelled when the session ends."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def change(self, change: Callable[[TrackedVideo], T]) -> T:
        """Stop where it is, do something, and show what came of it."""
        self.use()
        async with self._lock:
            video = self.video
            await self.player.stop()
            self.player.ended = False
            try:
                done = await self.run(partial(change, video))
                self.tell_state()
                await self.show()
            finally:
                self.player.catch_up(video)
        return done

    async def undo(self, redo: bool = False) -> Change:
        """Take the latest change back, or make the one again that was taken back last.

        Raises:
            NotReadyError: there is none.
        """
        change = await self.change(lambda video: video.redo() if redo else video.undo())
        if change is None:
            raise NotReadyError(f"there is nothing to {'redo' if redo else 'undo'}")
        frames = sorted({i for a, b in change.changed_frames() for i in range(a, b + 1)})
        for message in boxes_messages(self.video, frames) if self.viewers else ():
            self._tell(message)
        return change

    async def play(self, speed: float = 1.0, until: int | None = None) -> None:
        """Go forward by itself, from the last frame in which all is known.

        Args:
            speed: times the video's own; 0 for as fast as possible.
            until: the frame to stop at.
        """
        await self._play_from(lambda video: video.last_known_before(video.position), speed, until)

    async def seek(self, index: int) -> None:
        """Go to a frame; where others have to be tracked first, set out for it."""
        near = self.video.last_known_before(max(0, index))
        if near >= index:
            await self.look(index)
        else:
            await self._play_from(lambda _: near, AS_FAST_AS_POSSIBLE, index)

    async def look(self, index: int) -> None:
        """Go to a frame, tracking nothing."""
        await self.change(lambda video: video.show(max(0, index)))

    async def track(self, until: int | None = None) -> None:
        """Track as fast as possible what is not tracked yet."""

        def start(video: TrackedVideo) -> int:
            known = video.position if video.tracked_until is None else video.tracked_until
            return known if until is None else min(known, until)

        await self._play_from(start, AS_FAST_AS_POSSIBLE, until)

    async def _play_from(
        self, start: Callable[[TrackedVideo], int], speed: float, until: int | None
    ) -> None:
        self.use()
        async with self._lock:
            video = self.video
            await self.player.stop()
            near = start(video)
            if near != video.position:
                await self.run(lambda: video.show(near))
                await self.show()
            self.player.play(video, speed, until)
            self.tell_state()

    async def pause(self) -> None:
        """Stop where it is; where it does not play, also stop tracking again after a change."""
        self.use()
        async with self._lock:
            played = self.player.playing
            await self.player.stop()
            if self.tracked is not None:
                if not played:
                    self.tracked.give_up_catching_up()
                self.player.catch_up(self.tracked)
            self.tell_state()
            await self.show()

    async def finish_playing(self) -> None:
        """Wait until it has stopped by itself; raises TrackingFailedError where by an error."""
        await self.player.finish()

    async def moved(self, fast: bool) -> None:
        """See `re3.apps.server.playing.Listener`."""
        # What nobody looks at does not count as use, unless somebody waits for it.
        if self.viewers or fast:
            self.use()
        await self.show()

    async def tracked_again(self, frames: list[int]) -> None:
        """See `re3.apps.server.playing.Listener`."""
        for message in boxes_messages(self.video, frames) if self.viewers else ():
            self._tell(message)
        self.tell_state()

    async def stopped(self) -> None:
        """See `re3.apps.server.playing.Listener`."""
        if not self._closed:
            self.tell_state()
            for viewer in list(self.viewers):
                await self.catch_up(viewer)

    async def failed(self, told: str) -> None:
        """See `re3.apps.server.playing.Listener`."""
        self._tell({"type": "error", "error": told, "limit": None})

    def offer_picture(self, picture: bytes, viewer: Viewer | None = None) -> int:
        """Take a picture of the camera when there is time; see `CameraFeed.offer`."""
        self.use()
        return self._feed.offer(picture, viewer)

    async def take_picture(self, picture: bytes, at: float | None = None) -> None:
        """Track into a picture of the camera.

        Raises:
            SourceError, OverLimitError: it cannot be used.
        """
        self.use()
        if self.source != "camera":
            raise NotReadyError("frames can be sent to a session of source 'camera' only")
        first = self.tracked is None
        async with self._lock:
            await self.player.stop()
            now = time.monotonic() if at is None else at
            await self.run(partial(self._take, picture, now))
        if first:
            self.tell_state()

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
        if self.viewers:
            self._tell({"type": "state", "session": self.state()})

    def tell_progress(self, kind: str, done: float | None) -> None:
        """Tell all pages how far a file is: 0 to 1, or None where it is finished or given up."""
        self._tell({"type": "export", "kind": kind, "done": done})

    def _tell(self, message: Head) -> None:
        for viewer in self.viewers:
            viewer.tell(message)

    def state(self) -> Head:
        """How things are, as the API says it."""
        told: Head = {
            "id": self.id,
            "source": self.source,
            "title": self.title,
            "ready": self.tracked is not None,
            "playing": self.player.playing,
            "ended": self.player.ended,
            "fps": float(self.fps),
        }
        return told if self.tracked is None else told | video_message(self.tracked)

    async def close(self) -> None:
        """Stop, let go of the decoder, and remove all files."""
        self._closed = True
        self.player.cancel()
        self._feed.cancel()
        for task in self._tasks:
            task.cancel()
        if self._video is not None:
            decoder = self._video.video if isinstance(self._video, Recording) else self._video
            decoder.close()
        self._thread.shutdown(wait=False, cancel_futures=True)
        shutil.rmtree(self._folder, ignore_errors=True)

    def _open(self, path: Path) -> TrackedVideo:
        self._video = video = RemoteVideo(self._limits)
        video.open(path)
        return TrackedVideo(video, self._new_tracker, self._limits)

    def _new_tracker(self) -> MultiTracker:
        return MultiTracker(engine=self._engine)

    async def _take_offered(
        self, picture: bytes, at: float, viewer: Viewer | None, number: int
    ) -> None:
        await self.take_picture(picture, at)
        waited = round(1000 * (time.monotonic() - at), 1)
        await self.show(viewer, {"number": number, "server_ms": waited})

    def _take(self, picture: bytes, now: float) -> None:
        if self._video is None:
            pictures = self._folder / "pictures"
            pictures.mkdir(exist_ok=True)
            self._video, self.path = Recording(pictures, self._limits), pictures
        recording = self._video
        assert isinstance(recording, Recording)
        if not recording.timestamps:
            self._camera_started = now
        index = recording.append(picture, now - self._camera_started)
        if self.tracked is None:
            self.tracked = TrackedVideo(recording, self._new_tracker, self._limits)
            return
        self.tracked.show(self.tracked.last_known_before(index))
        while self.tracked.position < index and self.tracked.forward():
            pass
