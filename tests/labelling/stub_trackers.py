"""Trackers and footage for labelling: bright squares on a dark ground."""

from __future__ import annotations

import cv2
import numpy as np

SIZE = (96, 160)  # height, width


class Bright:
    """The box of the bright part nearest to the last box."""

    def init(self, frame, box_xywh):
        self.box = np.array(box_xywh, dtype=float)

    def update(self, frame):
        boxes = bright_boxes(frame)
        if len(boxes):
            centres = boxes[:, :2] + boxes[:, 2:] / 2
            distance = np.linalg.norm(centres - self.box[:2] - self.box[2:] / 2, axis=1)
            self.box = boxes[int(np.argmin(distance))]
        return self.box, 1.0


class Stays(Bright):
    """The first box in every frame."""

    def update(self, frame):
        return self.box, 1.0


class Larger(Bright):
    """The right box, but 1.25 times as wide and as high."""

    def update(self, frame):
        box, score = super().update(frame)
        return np.concatenate([box[:2] - box[2:] / 8, box[2:] * 1.25]), score


class Scripted:
    """Boxes by the frame's number, which its first pixel holds, and by that of the start."""

    def __init__(self, script):
        self.script = script

    def init(self, frame, box_xywh):
        self.start = int(frame[0, 0, 0])

    def update(self, frame):
        return np.array(self.script(self.start, int(frame[0, 0, 0])), dtype=float), 1.0


def bright_boxes(frame):
    _, _, parts, _ = cv2.connectedComponentsWithStats((frame[..., 0] > 180).astype(np.uint8))
    return parts[1:, :4].astype(float)


def ground(seed=0, size=SIZE):
    """Smooth dark noise, uint8 `[H, W, 3]`."""
    noise = np.random.default_rng(seed).uniform(0, 255, (size[0] // 4, size[1] // 4))
    smooth = cv2.resize(noise, size[::-1], interpolation=cv2.INTER_CUBIC)
    return np.repeat(np.clip(smooth * 0.5, 0, 120).astype(np.uint8)[..., None], 3, axis=2)


def square(t, speed=3, side=24):
    """Where the square is in frame t, xywh."""
    return np.array([10.0 + speed * t, 30, side, side])


def footage(count=40, speed=3, seed=0):
    """Frames of a bright square that goes to the right before a camera that stands still."""
    back = ground(seed)
    frames = []
    for t in range(count):
        frame = back.copy()
        paint(frame, square(t, speed))
        frames.append(frame)
    return frames


def paint(frame, box_xywh):
    x, y, width, height = np.asarray(box_xywh).astype(int)
    patch = np.random.default_rng(1).integers(200, 255, (height, width, 3), dtype=np.uint8)
    target = frame[y : y + height, x : x + width]
    target[:] = patch[: target.shape[0], : target.shape[1]]
