"""Going back in a video file by its keyframes, to frames that have been decoded before."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, dropwhile

import av

from re3.video.containers import ContainerSource


class SeekableSource(ContainerSource):
    """A video file that can go back.

    Indices are counted as in `ContainerSource`, not taken from the file's own index: going back
    looks for a frame by the time stamp it had when it was counted.
    """

    def __init__(self, location: str, *, skip_broken: bool = True) -> None:
        self._stamps: list[int | None] = []
        self._keyframes: list[int] = []
        self._times: list[float] = []
        self._looked_for: int | None = None
        super().__init__(location, skip_broken=skip_broken)

    def go_back(self, index: int) -> bool:
        """Let the frame be the next, though it was given before.

        Decoding begins at the second keyframe before it, as frames right after a keyframe may
        refer to what lies before. What is decoded then is the same in every file of a proper
        encoder; who has to be sure compares it with what came the first time.

        Returns:
            whether that worked; else open the file anew.
        """
        earlier = [at for at in self._keyframes if at <= index][-2:]
        stamp = self._stamps[earlier[0]] if earlier else None
        if stamp is None or self._stamps.count(stamp) > 1:
            return False
        self._decoder.close()
        try:
            self._container.seek(stamp, stream=self._stream, backward=True)
        except av.error.FFmpegError:
            return False
        self._decoded, self._looked_for = earlier[0], stamp
        self._decoder = self._decode(index)
        first = next(self._decoder, None)
        if first is None or first.index != index:
            return False
        self._frames = chain((first,), self._decoder)
        return True

    def _decoded_frames(self) -> Iterator[av.VideoFrame]:
        wanted, self._looked_for = self._looked_for, None
        for frame in dropwhile(
            lambda frame: wanted is not None and frame.pts != wanted, super()._decoded_frames()
        ):
            if self._decoded == len(self._stamps):
                self._stamps.append(frame.pts)
                if frame.key_frame:
                    self._keyframes.append(self._decoded)
            yield frame

    def _timestamp(self, index: int, frame: av.VideoFrame) -> float:
        # A frame that comes again keeps its time: the clock has gone on meanwhile.
        if index == len(self._times):
            self._times.append(super()._timestamp(index, frame))
        return self._times[index]
