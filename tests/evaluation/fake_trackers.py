"""Trackers that misbehave, to be made in another process by name."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np


class Follows:
    """A box that depends on every frame so far."""

    def init(self, frame, box_xywh):
        self.box = np.array(box_xywh, dtype=float)

    def update(self, frame):
        self.box = self.box + frame.mean() / 100.0
        return self.box, 0.5


class Raises(Follows):
    """Raises in its third update."""

    count = 0

    def update(self, frame):
        self.count += 1
        if self.count == 3:
            raise RuntimeError("no more")
        return super().update(frame)


class Hangs(Raises):
    """Never comes back from its third update."""

    def update(self, frame):
        try:
            return super().update(frame)
        except RuntimeError:
            time.sleep(1000)


class HangsAtStart(Follows):
    def init(self, frame, box_xywh):
        time.sleep(1000)


class Crashes(Raises):
    """Takes its process with it, in its third update."""

    def update(self, frame):
        try:
            return super().update(frame)
        except RuntimeError:
            os._exit(7)


class Garbage(Raises):
    """Gives no box in its third update."""

    def update(self, frame):
        try:
            return super().update(frame)
        except RuntimeError:
            return (np.nan,) * 4, 0.5


class Draws(Follows):
    """Draws from the global generator."""

    def update(self, frame):
        return self.box + np.random.rand(4), 0.5  # noqa: NPY002


class Slow(Follows):
    """Takes its time, and notes each start in the file that SLOW_LOG names."""

    def init(self, frame, box_xywh):
        with Path(os.environ["SLOW_LOG"]).open("a") as file:
            file.write(f"{os.getpid()}\n")
        super().init(frame, box_xywh)

    def update(self, frame):
        time.sleep(0.03)
        return super().update(frame)


class NotATracker:
    def init(self, frame, box_xywh):
        pass


class Grazes:
    """Overlaps the first box by less and less: from a pixel and a half down to a tenth of one."""

    def init(self, frame, box_xywh):
        self.box = np.array(box_xywh, dtype=float)
        self.updates = 0

    def update(self, frame):
        self.updates += 1
        overlap = max(1.6 - 0.15 * self.updates, 0.1)
        x, y, w, h = self.box
        return (x + w - overlap, y, w, h), 0.5
