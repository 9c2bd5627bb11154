"""The streaming tracker: one object or many, never looking ahead (Re3, sec. III-C)."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any, NamedTuple, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3 import geometry
from re3.confidence import (
    DOUBT_MARGIN,
    DOUBTED_FRAMES,
    SIDES_CHANGE,
    is_doubted,
    is_found,
    is_searched_for,
)
from re3.engine import Engine, State, load_engine, zero_state
from re3.engine.mirrored import MirroredEngine
from re3.engine.threads import checked_threads
from re3.frames import as_bgr
from re3.framing_bias import framing_bias, tried_boxes, without_bias
from re3.geometry import Floats
from re3.model_spec import CropSpec
from re3.models import DEFAULT_MODEL
from re3.motion import STILL, Step, camera_motion, thumbnail
from re3.per_process import PerProcess
from re3.result import Result, Status
from re3.search import PATCH_INTERVAL, PLACES, alike, cut_patch, places
from re3.track_memory import Track
from re3.whole_pixel_crop import whole_pixel_crop

Value = TypeVar("Value", bound=np.generic)


class TrackerOptions(TypedDict, total=False):
    """What `MultiTracker` takes by name, for those that hand it on; see there."""

    threads: int
    search: bool
    mirror: bool | None
    motion: bool
    framing: bool | None


class _Look(NamedTuple):
    """A crop to take: for which object, where, and with which memory."""

    track: Track
    box_xyxy: Floats
    state: State


class _Sight(NamedTuple):
    """What came of a look."""

    box_xyxy: Floats
    score: float
    state: State
    by_search: bool = False


class MultiTracker:
    """Tracks any number of objects through one video, in one batched network call per frame.

    Each is looked for where it is expected by its and the camera's motion (`re3.motion`), and if
    its score is low at more places (`re3.search`), in one more call.

    Frames are uint8 `[H, W, 3]` in BGR order (grey `[H, W]` and BGRA work too); their size may
    change. Boxes are x, y, width, height in pixels, as floats; (0, 0) is the top-left corner of
    the frame.

    Args:
        model: name of a shipped model (`re3 models` lists them) or path of an exported file.
        engine: "onnx-int8" (eight bits), "onnx" or "torch" (full precision, the same boxes),
            "openvino", "auto" for the first that the model has, or an engine of your own.
        threads: of the engine, and of cutting several crops; 0 takes one fewer than there are
            cores, 4 at most.
        search: look for an object that is lost in a wider and wider area, and where the frame looks
            like it, six crops more a frame; and where its score is low, and for a while after, one
            more, at the place where it was last sure.
        mirror: look at every crop mirrored as well, which is more accurate and takes about twice
            as long; None as the model says: `re3-base` does, no other.
        motion: look for an object where it is expected by its and the camera's motion, not about
            its last box. Without effect on a model that is shown a pair of crops: those it has
            learnt to compare are both of one place (Re3, sec. III-A).
        framing: keep to the box that was drawn, also where the network would draw it differently
            (`re3.framing_bias`); None does so unless each crop is looked at mirrored as well, as by
            `re3-base`. Without effect on a model that is shown a pair of crops.

    Raises:
        ValueError: unknown model or engine.
    """

    def __init__(
        self,
        model: str = DEFAULT_MODEL,
        engine: str | Engine = "auto",
        *,
        threads: int = 0,
        search: bool = True,
        mirror: bool | None = None,
        motion: bool = True,
        framing: bool | None = None,
    ) -> None:
        self._search = search
        self._threads = checked_threads(threads)
        self._arguments = {
            "model": model,
            "engine": engine,
            "threads": threads,
            "search": search,
            "mirror": mirror,
            "motion": motion,
            "framing": framing,
        }
        self._engine: Engine
        if isinstance(engine, str):
            self._engine = load_engine(model, engine, threads, mirror=mirror)
        else:
            self._engine = MirroredEngine(engine) if mirror else engine
        self._motion = motion and self._engine.spec.previous is None
        if framing is None:
            # Two looks gain as much in overlap, but lose in what their score says.
            framing = not isinstance(self._engine, MirroredEngine)
        self._framing = framing and self._engine.spec.previous is None
        self._thumbnail: NDArray[np.uint8] | None = None  # of the frame last seen
        self._tracks: dict[int, Track] = {}
        self._next_id = 1

    @property
    def results(self) -> dict[int, Result]:
        """The latest result of every object, by id."""
        return {identity: track.result for identity, track in self._tracks.items()}

    def add(self, frame: NDArray[np.uint8], box_xywh: ArrayLike, name: str | None = None) -> int:
        """Start to track an object.

        Args:
            frame: the frame that the box was drawn in; for objects added later on, the frame last
                given to `update`.
            box_xywh: x, y, width, height in pixels; may reach outside the frame.
            name: for people to read.

        Returns:
            the object's id, the key of its results.

        Raises:
            ValueError: an unusable frame; a box without area, not finite, or wholly outside.
        """
        image = as_bgr(frame)
        height, width = image.shape[:2]
        box = geometry.validate_box(box_xywh, width, height)
        if self._motion:
            self._thumbnail = thumbnail(image)
        identity = self._next_id
        self._tracks[identity] = self._start(
            image,
            box,
            Result(
                box_xywh=_as_tuple(box),
                score=1.0,
                status=Status.TRACKED,
                frame_index=0,
                object_id=identity,
                name=name,
            ),
        )
        self._next_id += 1
        return identity

    def remove(self, object_id: int) -> None:
        """Stop tracking an object; raises KeyError for an unknown id."""
        if object_id not in self._tracks:
            raise KeyError(f"no object {object_id}; tracked are {sorted(self._tracks)}")
        del self._tracks[object_id]

    def update(self, frame: NDArray[np.uint8]) -> dict[int, Result]:
        """Find every object in the next frame.

        Returns:
            id -> result; empty where nothing is tracked.

        Raises:
            ValueError: an unusable frame; the state stays as it was.
        """
        image = as_bgr(frame)
        if not self._tracks:
            return {}
        tracks = list(self._tracks.values())
        camera = self._camera_motion(image)
        seen = self._look(image, [_Look(t, self._expected(t, camera), t.state) for t in tracks])
        if self._search:
            seen = self._search_for_unsure(image, tracks, seen)
        for track, sight in zip(tracks, seen, strict=True):
            self._advance(track, image, sight, camera)
        return self.results

    def _camera_motion(self, image: NDArray[np.uint8]) -> Step:
        """Since the frame last seen; none for a tracker that does not ask."""
        if not self._motion:
            return STILL
        height, width = image.shape[:2]
        before, self._thumbnail = self._thumbnail, thumbnail(image)
        if before is None:
            return STILL
        return camera_motion(before, self._thumbnail, width, height)

    def _expected(self, track: Track, camera: Step) -> Floats:
        """The box `[4]` about which an object is looked for first."""
        # A lost one is left to the search: a box that went on with a camera would leave the frame.
        if not self._motion or track.result.status is Status.LOST:
            return track.box_xyxy
        return track.motion.ahead(track.box_xyxy, camera)

    def _look(self, image: NDArray[np.uint8], looks: list[_Look]) -> list[_Sight]:
        """What each look finds; all in one network call."""
        spec = self._engine.spec
        boxes = np.stack([look.box_xyxy for look in looks])
        regions = self._regions(boxes, spec.current)
        output = self._engine.step(
            _stacked([look.track.previous_crop for look in looks]),
            self._cut(image, regions, spec.current),
            {name: _batch([look.state[name] for look in looks]) for name in spec.state},
        )
        height, width = image.shape[:2]
        found = geometry.decode(output.corners, regions)
        found = without_bias(found, np.stack([look.track.framing_bias for look in looks]))
        # A network gone astray must not poison the crops to come: keep the box it had.
        found = np.where(np.isfinite(found).all(axis=1, keepdims=True), found, boxes)
        found = geometry.clip_inside(found, width, height)
        return [
            _Sight(found[i], float(output.score[i]), {n: v[i] for n, v in output.state.items()})
            for i in range(len(looks))
        ]

    def _search_for_unsure(
        self, image: NDArray[np.uint8], tracks: list[Track], seen: list[_Sight]
    ) -> list[_Sight]:
        """Sights of the tracks, those of low score replaced where a search is sure of another."""
        looks, whose, least = [], [], []
        for index, (track, sight) in enumerate(zip(tracks, seen, strict=True)):
            if is_searched_for(sight.score, track.scores.usual):
                boxes = self._places(image, track, sight)
                margin = 0.0
            elif is_doubted(sight.score, track.scores.usual, track.doubted_frames):
                boxes, margin = track.lost_at_xyxy[None], DOUBT_MARGIN
            else:
                continue
            looks += [_Look(track, box, track.first_state) for box in boxes]
            whose += [index] * len(boxes)
            least += [sight.score + margin] * len(boxes)
        best, looked = list(seen), self._look(image, looks) if looks else ()
        for index, score, sight in zip(whose, least, looked, strict=True):
            better = sight.score >= max(score, best[index].score)
            if better and is_found(sight.score, tracks[index].scores.usual):
                best[index] = sight._replace(by_search=True)
        return best

    def _places(self, image: NDArray[np.uint8], track: Track, sight: _Sight) -> Floats:
        """Boxes `[K, 4]` to look at for an object that is searched for, K up to `PLACES`."""
        # An object that may still be there is not looked for elsewhere, where others are like it.
        if track.scores.status(sight.score) is not Status.LOST:
            return track.trusted_xyxy[None]
        height, width = image.shape[:2]
        frames = track.searched_for + 1
        patches = (track.first_patch, track.last_patch)
        # An object that leaves is trusted while ever less of it is in sight, and comes back whole.
        middle = geometry.convert(track.trusted_xyxy, "xyxy", "cxcywh")[:2]
        whole = geometry.convert(np.concatenate([middle, track.sure_sides]), "cxcywh", "xyxy")
        likely = alike(image, patches, whole, frames)
        near = places(whole, frames, width, height, PLACES - len(likely))
        return np.concatenate([near, likely])

    def save_state(self) -> dict[str, NDArray]:
        """Everything remembered, as plain arrays (for `numpy.savez`, say)."""
        saved: dict[str, NDArray] = {
            "model": np.array(self._engine.spec.name),
            "next_id": np.array(self._next_id),
            "ids": np.array(list(self._tracks), dtype=np.int64),
        }
        if self._thumbnail is not None:
            saved["thumbnail"] = self._thumbnail.copy()
        for track in self._tracks.values():
            saved |= track.save()
        return saved

    def load_state(self, saved: Mapping[str, NDArray]) -> None:
        """Go on exactly where `save_state` was called, in this or another tracker.

        Raises:
            ValueError: saved with another model, or not such a state; nothing is changed.
        """
        spec = self._engine.spec
        _check_saved(saved)
        try:
            model = str(saved["model"])
            if model != spec.name:
                raise ValueError(
                    f"the state was saved with model {model!r}, this tracker runs {spec.name!r}; "
                    "load it into a tracker of the same model"
                )
            tracks = {i: Track.restore(saved, i, spec) for i in map(int, saved["ids"])}
            next_id = int(saved["next_id"])
            small = saved.get("thumbnail")
        except KeyError as error:
            raise ValueError(
                f"the saved state lacks {error}; expected what save_state() returned"
            ) from error
        self._tracks, self._next_id = tracks, next_id
        self._thumbnail = None if small is None else np.array(small, np.uint8)

    def _start(self, image: NDArray[np.uint8], box_xywh: Floats, result: Result) -> Track:
        """The first forward pass; the box it finds is discarded in favour of the one given."""
        spec = self._engine.spec
        box = geometry.convert(box_xywh, "xywh", "xyxy")
        previous = self._crop_previous(image, box)
        nothing = {name: values[0] for name, values in zero_state(spec, 1).items()}
        state = self._look_at_one_frame(image, box, previous, nothing)
        patch = cut_patch(image, box)
        sides = box[2:] - box[:2]
        track = Track(box, previous, state, state, 0, result, box, box, sides, patch, patch)
        if self._framing:
            seen = self._look(image, [_Look(track, tried, state) for tried in tried_boxes(box)])
            track.framing_bias = framing_bias(np.stack([sight.box_xyxy for sight in seen]), box)
        return track

    def _look_at_one_frame(
        self,
        image: NDArray[np.uint8],
        box_xyxy: Floats,
        previous_crop: NDArray[np.uint8] | None,
        state: State,
    ) -> State:
        """The state after a pass with both crops about a box in the same frame."""
        spec = self._engine.spec
        region = self._regions(box_xyxy, spec.current)
        output = self._engine.step(
            _stacked([previous_crop]),
            self._cut(image, region[None], spec.current),
            {name: state[name][None] for name in spec.state},
        )
        return {name: values[0] for name, values in output.state.items()}

    def _advance(self, track: Track, image: NDArray[np.uint8], sight: _Sight, camera: Step) -> None:
        spec = self._engine.spec
        # An object taken back is seen with the memory of the first frame.
        track.steps = 1 if sight.by_search else track.steps + 1
        track.state = sight.state
        reset = 0 < spec.reset_interval <= track.steps
        if reset:
            kept = {name: sight.state[name] for name in spec.kept_at_reset}
            track.state, track.steps = {**track.first_state, **kept}, 0
        status = track.scores.status(sight.score)
        box = sight.box_xyxy
        if status is not Status.TRACKED:
            box = geometry.sides_near(box, track.trusted_xyxy, SIDES_CHANGE)
        # What was not in sight before, or was found by a search, has not moved but been found.
        if Status.LOST in (status, track.result.status) or sight.by_search:
            track.motion = track.motion.unseen()
        elif status is Status.TRACKED:
            track.motion = track.motion.after(track.box_xyxy, box, camera)
        track.box_xyxy = box
        searching = is_searched_for(sight.score, track.scores.usual)
        track.searched_for = track.searched_for + 1 if searching else 0
        track.doubted_frames = DOUBTED_FRAMES if searching else max(0, track.doubted_frames - 1)
        track.scores = track.scores.after(sight.score)
        if status is Status.TRACKED:
            track.trusted_xyxy = box
        if sight.score >= track.scores.usual:
            track.sure_sides = box[2:] - box[:2]
            if track.result.frame_index % PATCH_INTERVAL == 0:
                track.last_patch = cut_patch(image, box)
        if not track.doubted_frames:
            track.lost_at_xyxy = track.trusted_xyxy
        track.previous_crop = self._crop_previous(image, box)
        if reset and spec.look_at_reset:
            track.state = self._look_at_one_frame(image, box, track.previous_crop, track.state)
        track.result = Result(
            box_xywh=_as_tuple(geometry.convert(box, "xyxy", "xywh")),
            score=sight.score,
            status=status,
            frame_index=track.result.frame_index + 1,
            object_id=track.result.object_id,
            name=track.result.name,
        )

    def _crop_previous(
        self, image: NDArray[np.uint8], box_xyxy: Floats
    ) -> NDArray[np.uint8] | None:
        spec = self._engine.spec
        if spec.previous is None:
            return None
        region = self._regions(box_xyxy, spec.previous)
        return self._cut(image, region[None], spec.previous)[0]

    def _regions(self, boxes_xyxy: Floats, view: CropSpec) -> Floats:
        """The regions `[..., 4]` that crops about boxes show, and that boxes are decoded from."""
        regions = geometry.search_region(boxes_xyxy, view.context)
        # Whole pixels need no grid against rounding errors, and one would move edges near half a
        # pixel to the other side.
        return regions if self._engine.spec.whole_pixels else geometry.snap(regions)

    def _cut(
        self, image: NDArray[np.uint8], regions_xyxy: Floats, view: CropSpec
    ) -> NDArray[np.uint8]:
        """Every crop is cut here, where `re3.timed_tracker` puts its clock.

        Args:
            regions_xyxy: `[N, 4]` in pixels.

        Returns:
            `[N, S, S, 3]`.
        """
        spec = self._engine.spec
        crop = whole_pixel_crop if spec.whole_pixels else geometry.crop

        def cut(region_xyxy: Floats) -> NDArray[np.uint8]:
            return crop(image, region_xyxy, view.size, spec.fill)

        if self._threads == 1 or len(regions_xyxy) <= self._threads:
            return _batch([cut(region) for region in regions_xyxy])
        return np.stack(list(self._pools.get().map(cut, regions_xyxy)))

    @cached_property
    def _pools(self) -> PerProcess[ThreadPoolExecutor]:
        return PerProcess(lambda: ThreadPoolExecutor(self._threads, thread_name_prefix="re3-crops"))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled and copied by its arguments and `save_state`."""
        if not isinstance(self._arguments["engine"], str):
            raise TypeError(
                "a tracker that was made with an Engine object cannot be pickled or copied; make "
                "another one and hand it save_state(), or give the engine by name"
            )
        return _restored, (type(self), self._arguments, self.save_state())


class Tracker:
    """Tracks one object; see `MultiTracker` for frames, boxes and arguments.

    Examples:
        >>> tracker = Tracker()
        >>> tracker.init(frame, (x, y, w, h))
        >>> result = tracker.update(next_frame)
        >>> result.box_xywh, result.score, result.status
    """

    def __init__(
        self,
        model: str = DEFAULT_MODEL,
        engine: str | Engine = "auto",
        **options: Unpack[TrackerOptions],
    ) -> None:
        self._multi = MultiTracker(model, engine, **options)

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> Result:
        """Start to track the object in the box, forgetting any earlier one.

        Args:
            frame: uint8 `[H, W, 3]` BGR.
            box_xywh: x, y, width, height in pixels; may reach outside the frame.

        Returns:
            the first result: the box given, with score 1 and frame index 0.

        Raises:
            ValueError: an unusable frame or box; an object tracked before stays.
        """
        identity = self._multi.add(frame, box_xywh)
        for other in set(self._multi.results) - {identity}:
            self._multi.remove(other)
        return self._only()

    def update(self, frame: NDArray[np.uint8]) -> Result:
        """Find the object in the next frame.

        Raises:
            RuntimeError: called before `init`.
            ValueError: an unusable frame; the state stays as it was.
        """
        if not self._multi.results:
            raise RuntimeError("update() before init(); give the first frame and its box to init()")
        self._multi.update(frame)
        return self._only()

    def save_state(self) -> dict[str, NDArray]:
        """Everything remembered, as plain arrays."""
        return self._multi.save_state()

    def load_state(self, saved: Mapping[str, NDArray]) -> None:
        """Go on exactly where `save_state` was called; raises ValueError if it does not fit."""
        if len(saved.get("ids", ())) > 1:
            raise ValueError(
                f"the state holds {len(saved['ids'])} objects; load it into a MultiTracker"
            )
        self._multi.load_state(saved)

    def _only(self) -> Result:
        (result,) = self._multi.results.values()
        return result


def _restored(
    kind: type[MultiTracker], arguments: dict[str, Any], saved: Mapping[str, NDArray]
) -> MultiTracker:
    """A tracker as it was pickled."""
    tracker = kind(**arguments)
    tracker.load_state(saved)
    return tracker


def _check_saved(saved: Mapping[str, NDArray]) -> None:
    """Raise ValueError where a saved state holds objects, which are not run, or infinity."""
    for name, values in saved.items():
        array = np.asarray(values)
        if array.dtype == object:
            raise ValueError(
                f"the saved state holds Python objects in {name!r}; expected the arrays that "
                "save_state() returned"
            )
        if array.dtype.kind == "f" and np.isinf(array).any():
            raise ValueError(
                f"the saved state holds infinity in {name!r}; expected what save_state() returned"
            )


def _batch(arrays: list[NDArray[Value]]) -> NDArray[Value]:
    """Arrays of one shape along a new first axis; of a single one nothing is copied."""
    return arrays[0][None] if len(arrays) == 1 else np.stack(arrays)


def _stacked(crops: list[NDArray[np.uint8] | None]) -> NDArray[np.uint8] | None:
    """One batch of the previous crops; None for a model without them."""
    present = [crop for crop in crops if crop is not None]
    return _batch(present) if present else None


def _as_tuple(box: Floats) -> tuple[float, float, float, float]:
    x, y, w, h = (float(value) for value in box)
    return x, y, w, h
