"""What can be drawn from packed shards: tracks, stills and their objects as flat tables."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Several
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from re3.data.packed.shards import FRAMES_PER_PART, PackedSource, Shard, decode_all
from re3.geometry import Floats

OUTLINE_POINTS = 32


@dataclass(frozen=True, eq=False)
class TrackTable:
    """One object in one video.

    Attributes:
        first_image: index into the bank of the frame of the first box.
        boxes_xyxy: float64 `[T, 4]` in pixels of the packed frames; NaN where absent.
        annotated: int64, the frames with a box.
        width, height: of the frames.
        source: index into `PackedIndex.names`.
    """

    first_image: int
    boxes_xyxy: Floats
    annotated: NDArray[np.int64]
    width: int
    height: int
    source: int


@dataclass(eq=False)
class PackedIndex:
    """Everything but the pictures.

    Attributes:
        image_sizes: int64 `[I, 2]`, width and height of every picture of the bank.
        names: of the sources, or of the datasets of a source without a name.
        tracks: that can be drawn, and `track_weights`, the probability of each.
        still_image: int64 `[S]`, index of each still into the bank.
        still_weights: `[S]`, the probability of each.
        still_source: int64 `[S]`, index into `names`.
        first_object, objects: int64 `[S]`, of each still: rows of the tables that follow.
        object_rectangle: float64 `[O, 4]`, xyxy.
        object_number: int64 `[O]`, in the picture's mask; 0 where there is none.
        object_outline: float64 `[O, OUTLINE_POINTS, 2]`, points that span its convex hull.
    """

    image_sizes: NDArray[np.int64]
    names: list[str]
    tracks: list[TrackTable]
    track_weights: Floats
    still_image: NDArray[np.int64]
    still_weights: Floats
    still_source: NDArray[np.int64]
    first_object: NDArray[np.int64]
    objects: NDArray[np.int64]
    object_rectangle: Floats
    object_number: NDArray[np.int64]
    object_outline: Floats
    _shards: list[Shard] = field(default_factory=list, repr=False)
    _positions: dict[tuple[int, str], int] = field(default_factory=dict, repr=False)

    def pictures(
        self, pool: Executor
    ) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8] | None]]:
        """All pictures, as `re3.training.packed.bank.fill_bank` takes them."""
        place = {id(shard): index for index, shard in enumerate(self._shards)}
        for shard, file, frames, numbers in decode_all(self._shards, pool):
            yield self._positions[place[id(shard)], file], frames, numbers


def index_shards(shards: Several[Shard], smallest: float) -> PackedIndex:
    """The tables of all shards.

    Args:
        shards: of one mix.
        smallest: tracks whose boxes have a median shorter side below this many pixels are left
            out.

    Raises:
        ValueError: there is nothing to draw from.
    """
    builder = _Builder(shards[0].index.sources)
    for place, shard in enumerate(shards):
        builder.add(place, shard, smallest)
    return builder.finish(list(shards))


class _Builder:
    def __init__(self, sources: tuple[PackedSource, ...]) -> None:
        self.sources = sources
        self.names: list[str] = []
        self.sizes: list[tuple[int, int]] = []
        self.positions: dict[tuple[int, str], int] = {}
        self.tracks: list[TrackTable] = []
        self.track_of: list[tuple[int, str]] = []  # source and dataset
        self.stills: list[tuple[int, int, int, int]] = []  # image, source, first object, objects
        self.still_of: list[int] = []
        self.rectangles: list[Floats] = []
        self.numbers: list[int] = []
        self.outlines: list[Floats] = []

    def name(self, source: int, dataset: str) -> int:
        name = self.sources[source].name or dataset
        if name not in self.names:
            self.names.append(name)
        return self.names.index(name)

    def add(self, place: int, shard: Shard, smallest: float) -> None:
        index = shard.index
        starts = []
        for video in index.videos:
            starts.append(len(self.sizes))
            first = len(self.sizes)
            for file in video.files:
                self.positions[place, file] = first
                first += FRAMES_PER_PART
            self.sizes += [(video.width, video.height)] * video.frames
        for track in index.tracks:
            video = index.videos[track.video]
            boxes = track.boxes_xywh.copy()
            boxes[:, 2:] += boxes[:, :2]
            annotated = np.flatnonzero(~np.isnan(boxes[:, 0]))
            if len(annotated) < 2:
                continue
            if np.median(track.boxes_xywh[annotated, 2:].min(axis=1)) < smallest:
                continue
            source = self.name(track.source, track.dataset)
            self.track_of.append((track.source, track.dataset))
            self.tracks.append(
                TrackTable(
                    starts[track.video] + track.first,
                    boxes,
                    annotated,
                    video.width,
                    video.height,
                    source,
                )
            )
        for still in index.stills:
            image = len(self.sizes)
            self.positions[place, still.file] = image
            self.sizes.append((still.width, still.height))
            first_object, count = len(self.numbers), 0
            for number, (box, outline) in enumerate(
                zip(still.boxes_xywh, still.outlines, strict=True), start=1
            ):
                x, y, w, h = box
                rectangle = np.array(
                    [max(x, 0), max(y, 0), min(x + w, still.width), min(y + h, still.height)]
                )
                if (rectangle[2:] - rectangle[:2]).min() < 4:
                    continue
                self.rectangles.append(rectangle)
                self.numbers.append(0 if outline is None else number)
                corners = rectangle[[[0, 1], [2, 1], [0, 3], [2, 3]]]
                points = corners if outline is None else outline
                self.outlines.append(points[np.arange(OUTLINE_POINTS) % len(points)])
                count += 1
            if count:
                source = self.name(still.source, still.dataset)
                self.stills.append((image, source, first_object, count))
                self.still_of.append(still.source)

    def finish(self, shards: list[Shard]) -> PackedIndex:
        if not self.tracks and not self.stills:
            raise ValueError("the shards hold neither a track nor a still with an object")
        table = np.array(self.stills, dtype=np.int64).reshape(-1, 4)
        return PackedIndex(
            image_sizes=np.array(self.sizes, dtype=np.int64),
            names=self.names,
            tracks=self.tracks,
            track_weights=self._track_weights(),
            still_image=table[:, 0],
            still_weights=self._still_weights(),
            still_source=table[:, 1],
            first_object=table[:, 2],
            objects=table[:, 3],
            object_rectangle=np.array(self.rectangles).reshape(-1, 4),
            object_number=np.array(self.numbers, dtype=np.int64),
            object_outline=np.array(self.outlines).reshape(-1, OUTLINE_POINTS, 2),
            _shards=shards,
            _positions=self.positions,
        )

    def _still_weights(self) -> Floats:
        sources = np.array(self.still_of, dtype=np.int64)
        weights = np.zeros(len(sources))
        for source in np.unique(sources):
            those = sources == source
            weights[those] = self.sources[source].weight / those.sum()
        return weights / weights.sum() if len(weights) else weights

    def _track_weights(self) -> Floats:
        """Datasets of a source, and tracks of a dataset, by the root of their length."""
        lengths = np.array([float(len(track.annotated)) for track in self.tracks])
        weights = np.zeros(len(lengths))
        for source in {source for source, _ in self.track_of}:
            own = np.zeros(len(lengths))
            for dataset in {d for s, d in self.track_of if s == source}:
                those = np.array([of == (source, dataset) for of in self.track_of])
                roots = np.sqrt(lengths) * those
                own += roots / roots.sum() * np.sqrt((lengths * those).sum())
            weights += own / own.sum() * self.sources[source].weight
        return weights / weights.sum() if len(weights) else weights
