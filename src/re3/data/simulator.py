"""Synthetic sequences from still pictures (Re3, sec. III-C, "Training from Synthetic Sequences").

A scene is a stack of layers: a background that the camera pans over, look-alikes behind the
object, the object, occluders before it. Each layer has an affine path; speed, direction, scale
and aspect ratio wander with Gaussian noise. In some clips the object leaves (`re3.data.leaving`).
Crops are rendered directly from the layers, so that only pixels that are looked at cost anything.
"""

from __future__ import annotations

from collections.abc import Sequence as Several

import cv2
import numpy as np
from numpy.typing import NDArray

from re3.data.bending import bend, with_margin
from re3.data.leaving import chance_of_leaving, draw_absence, hide_behind, move_out
from re3.data.scene import Layer, Look, Scene
from re3.data.simulation_config import SimulationConfig
from re3.data.stills import Still
from re3.geometry import Floats

FINEST_PIXELS = 110.0
"""Layers are kept at no more pixels per object: crops show the object at 64."""


def simulate(
    stills: Several[Still],
    frames: int,
    rng: np.random.Generator,
    config: SimulationConfig | None = None,
    leap: int = 1,
) -> Scene:
    """Draw a scene of so many frames.

    Args:
        stills: pictures to choose from.
        frames: length of the clip, 1 or more.
        rng: source of all chance.
        config: what scenes are drawn.
        leap: frames from the first to the second; all others follow each other.
    """
    times = np.arange(frames)
    times[1:] += leap - 1
    return _SceneBuilder(stills, times, rng, config or SimulationConfig()).build()


class _SceneBuilder:
    def __init__(
        self,
        stills: Several[Still],
        times: NDArray[np.int64],
        rng: np.random.Generator,
        config: SimulationConfig,
    ) -> None:
        self.stills, self.times, self.rng, self.config = stills, times, rng, config
        self.frames = len(times)
        self.elapsed = np.diff(times, prepend=times[0] - 1).astype(np.float64)

    def build(self) -> Scene:
        rng, config = self.rng, self.config
        way = self._draw_way()
        still = self._pick()
        picture, patch, alpha, masked = self._object_of(still)
        own_size = float(np.sqrt(patch.shape[0] * patch.shape[1]))
        self.unit = float(np.exp(rng.uniform(*np.log(config.object_pixels))))  # object, pixels
        self.resolution = min(1.0, FINEST_PIXELS / self.unit)

        # Its own picture shows it a second time: it would stay behind where the object leaves.
        foreign = rng.random() < config.foreign or way is not None
        backdrop = self._pick().read() if foreign else picture
        zoom = self.unit / own_size * np.exp(rng.normal(0.0, 0.35))
        # Objects fill stills more than they fill frames: leave room to move, reflect what lacks.
        room = rng.uniform(*config.room) * self.unit
        zoom = max(zoom, 0.8 * room / min(backdrop.shape[:2]))
        extent = np.array(backdrop.shape[1::-1]) * zoom
        scene = np.maximum(extent * rng.uniform(0.7, 1.0), room)
        self.scene = (int(scene[0]), int(scene[1]))

        target = self._layer(
            patch, alpha, self.unit / own_size, self._wander(self._speed(config.speed)), masked
        )
        layers = [self._backdrop_layer(backdrop, zoom, (extent - scene) / 2)]
        centres = target.boxes_xyxy()
        centres = (centres[:, :2] + centres[:, 2:]) / 2
        if rng.random() < config.twin:
            layers.append(self._companion(patch, alpha, centres, own_size, masked))
        if rng.random() < config.other:
            _, other, other_alpha, other_masked = self._pick_object()
            size = float(np.sqrt(other.shape[0] * other.shape[1]))
            layers.append(self._companion(other, other_alpha, centres, size, other_masked))
        layers.append(target)
        position = len(layers) - 1
        mean = config.occluders * (1.0 if self.frames > 8 else 0.5)
        for _ in range(min(int(rng.poisson(mean)), 3)):
            layers.append(self._occluder(picture, centres))
        if way is not None:
            layers = self._leave(way, layers, position)
        return Scene(self.scene, layers, position, config.fill, bool(self.elapsed.max() > 1), still)

    def _draw_way(self) -> str | None:
        """How the object leaves; None where it does not. Draws nothing where it never does."""
        chance = chance_of_leaving(self.config.leaves, self.frames)
        if not chance or self.rng.random() >= chance:
            return None
        return self.config.leaves_by[int(self.rng.integers(len(self.config.leaves_by)))]

    def _leave(self, way: str, layers: list[Layer], target: int) -> list[Layer]:
        """The layers of a scene that the object leaves."""
        leaps = bool(self.elapsed.max() > 1)
        absence = draw_absence(self.frames, int(leaps), self.rng)
        if way != "behind":
            moving = range(len(layers)) if way == "camera" else (target,)
            return move_out(layers, target, moving, self.scene, absence, self.rng)
        cover = self._random_patch(self._pick().read())
        return hide_behind(layers, target, cover, self.times, absence, self.resolution, self.rng)

    def _walk(self, step: float, *more: int) -> Floats:
        """A random walk `[T, *more]` with that standard deviation a frame."""
        draws = self.rng.normal(0.0, step, (self.frames, *more))
        return np.cumsum(draws.T * np.sqrt(self.elapsed), axis=-1).T

    def _pick(self) -> Still:
        return self.stills[int(self.rng.integers(len(self.stills)))]

    def _pick_object(
        self,
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8], bool]:
        return self._object_of(self._pick())

    def _object_of(
        self, still: Still
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8], bool]:
        """A picture, the patch of one of its objects, its alpha, and whether that is a mask."""
        picture = still.read()
        height, width = picture.shape[:2]
        (x, y, w, h), mask = still.draw_object(width, height, self.rng)
        left, top = (
            int(np.clip(round(float(low)), 0, side - 4)) for low, side in ((x, width), (y, height))
        )
        right = int(np.clip(round(x + w), left + 4, width))
        bottom = int(np.clip(round(y + h), top + 4, height))
        patch = picture[top:bottom, left:right]
        if mask is not None:
            alpha = mask[top:bottom, left:right]
            if (alpha > 127).mean() > 0.05:
                # One pixel less and a soft edge hide the seam of the cut.
                return picture, patch, cv2.GaussianBlur(alpha, (3, 3), 0), True
        return picture, patch, np.full(patch.shape[:2], 255, dtype=np.uint8), False

    def _speed(self, limits: tuple[float, float]) -> float:
        return float(np.exp(self.rng.uniform(*np.log(limits))))

    def _wander(self, speed: float) -> Floats:
        """Centres `[T, 2]` in scene pixels of a walk that stays inside the scene."""
        rng, limit = self.rng, np.array(self.scene, dtype=np.float64)
        step = speed * self.unit
        # Whole inside at first where there is room, so that the clip starts with the object in it.
        margin = np.minimum(0.75 * self.unit / limit, 0.45)
        position = rng.uniform(margin, 1.0 - margin) * limit
        velocity = rng.normal(0.0, step, 2)
        centres = np.empty((self.times[-1] + 1, 2))
        for t in range(len(centres)):
            centres[t] = position
            velocity = 0.95 * velocity + rng.normal(0.0, self.config.turning * step, 2)
            position = position + velocity
            outside = (position < 0) | (position > limit)
            velocity[outside] *= -1.0
            position = np.clip(position, 0, limit)
        return centres[self.times]

    def _layer(
        self,
        patch: NDArray[np.uint8],
        alpha: NDArray[np.uint8],
        scale: float,
        centres: Floats,
        masked: bool,
    ) -> Layer:
        """A cut-out on the path of its centre; scale, aspect ratio and angle wander."""
        rng, config = self.rng, self.config
        activity = rng.exponential(1.0)
        log_scale = self._walk(config.scaling * activity)
        log_aspect = self._walk(config.stretching * activity)
        log_scale, log_aspect = np.clip(log_scale, -1.2, 1.2), np.clip(log_aspect, -0.7, 0.7)
        angle = self._walk(config.spinning * activity) * masked

        bent = masked and rng.random() < config.bent
        if bent:
            patch, alpha = with_margin(patch, alpha)
        image, alpha = _resized(patch, alpha, scale * self.resolution)
        cut_outs = [(image, alpha)]
        if bent:
            cut_outs = bend(image, alpha, self.times, config.bending * activity, rng)
        looks = [Look.cut_out(*cut_out) for cut_out in cut_outs]
        size = np.array(image.shape[1::-1], dtype=np.float64)
        base = scale * np.array(patch.shape[1::-1]) / size  # picture pixels to scene pixels
        paths = np.empty((self.frames, 2, 3))
        stretch = np.stack([log_scale + log_aspect / 2, log_scale - log_aspect / 2], axis=1)
        stretch = np.exp(stretch - stretch[0]) * base  # [T, 2]
        cos, sin = np.cos(angle), np.sin(angle)
        paths[:, 0, 0], paths[:, 0, 1] = cos * stretch[:, 0], -sin * stretch[:, 1]
        paths[:, 1, 0], paths[:, 1, 1] = sin * stretch[:, 0], cos * stretch[:, 1]
        paths[:, :, 2] = centres - paths[:, :, :2] @ (size / 2)
        return Layer(looks, paths)

    def _backdrop_layer(self, picture: NDArray[np.uint8], zoom: float, margin: Floats) -> Layer:
        rng = self.rng
        step = self._speed(self.config.camera) * self.unit
        velocity = self._walk(0.3 * step, 2) + rng.normal(0.0, step, 2)
        offset = -margin + np.cumsum(velocity * self.elapsed[:, None], axis=0) - velocity[0]
        image, _ = _resized(picture, None, min(zoom * self.resolution, 1.5))
        base = zoom * np.array(picture.shape[1::-1]) / np.array(image.shape[1::-1])
        growth = np.exp(self._walk(0.004))
        paths = np.zeros((self.frames, 2, 3))
        paths[:, 0, 0], paths[:, 1, 1] = base[0] * growth, base[1] * growth
        paths[:, :, 2] = offset
        return Layer([Look.background(image)], paths)

    def _companion(
        self,
        patch: NDArray[np.uint8],
        alpha: NDArray[np.uint8],
        centres: Floats,
        own_size: float,
        masked: bool,
    ) -> Layer:
        """Something that moves near the object, behind it."""
        rng = self.rng
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 2.5) * self.unit
        beside = centres[0] + distance * np.array([np.cos(angle), np.sin(angle)])
        drift = self._walk(0.03 * self.unit, 2)
        follows = rng.uniform(0.0, 1.0)
        path = beside + follows * (centres - centres[0]) + drift
        scale = self.unit * np.exp(rng.normal(0.0, 0.2)) / own_size
        return self._layer(patch, alpha, scale, path, masked)

    def _occluder(self, picture: NDArray[np.uint8], centres: Floats) -> Layer:
        """A random patch that passes before the object at some moment of the clip."""
        rng = self.rng
        if rng.random() < self.config.other_occluders:
            picture, patch, alpha, _ = self._pick_object()
        else:
            patch, alpha = self._random_patch(picture)
        own_size = float(np.sqrt(patch.shape[0] * patch.shape[1]))
        size = self.unit * rng.uniform(0.4, 1.4)
        meeting = int(rng.integers(self.frames))
        aim = centres[meeting] + rng.normal(0.0, 0.35 * self.unit, 2)
        angle = rng.uniform(0, 2 * np.pi)
        speed = self._speed((0.02, 0.4)) * self.unit
        velocity = speed * np.array([np.cos(angle), np.sin(angle)])
        times = (self.times - self.times[meeting])[:, None]
        return self._layer(patch, alpha, size / own_size, aim + times * velocity, False)

    def _random_patch(
        self, picture: NDArray[np.uint8]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        rng, (height, width) = self.rng, picture.shape[:2]
        w, h = (max(6, int(side * rng.uniform(0.1, 0.5))) for side in (width, height))
        left, top = int(rng.integers(width - w + 1)), int(rng.integers(height - h + 1))
        patch = picture[top : top + h, left : left + w]
        alpha = np.full((h, w), 255, dtype=np.uint8)
        if rng.random() < 0.5:
            alpha[:] = 0
            cv2.ellipse(alpha, ((w / 2, h / 2), (w, h), 0.0), 255, -1)
        return patch, alpha


def _resized(
    image: NDArray[np.uint8], alpha: NDArray[np.uint8] | None, scale: float
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Shrunk by area averaging (never enlarged: the warp does that)."""
    if scale < 1.0:
        height, width = image.shape[:2]
        size = (max(4, round(width * scale)), max(4, round(height * scale)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if alpha is not None:
            alpha = cv2.resize(alpha, size, interpolation=cv2.INTER_AREA)
    if alpha is None:
        alpha = np.full(image.shape[:2], 255, dtype=np.uint8)
    return image, alpha
