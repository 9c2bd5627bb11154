"""Success, precision and their relatives, for one track against its truth.

The measures of the one-pass evaluation (Wu, Lim, Yang: Online object tracking: a benchmark, CVPR
2013), with the conventions of its tool kit:

* The first annotated frame is where the tracker was given the truth. It counts, with the truth as
  the tracker's box, as in the OTB figures that trackers publish. AO, SR.50 and SR.75 are GOT-10k's
  and leave it out, as GOT-10k does.
* Frames without truth (NaN) are left out, whatever the tracker says there.
* A frame for which the tracker has no box (NaN) is one with overlap 0 and infinite distance.
* An overlap has to be above a threshold (`>`), a distance at or below it (`<=`).

With `otb_rules` the figures are those of OTB's MATLAB toolkit to the last frame (its
`calcSeqErrRobust` and `genPerfMat`), which differs where boxes are missing:

* where the tracker has no box, or one without an area, its last box is repeated;
* a frame without a true box, or whose true box has x or y at or below 0 in OTB's pixels, counted
  from 1, is compared with nothing: it is a miss of every overlap and a hit of every distance, and
  counts in the number of frames all the same.

Box arrays are `[T, 4]`, xywh in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.geometry import iou_xywh

Floats = NDArray[np.float64]

OVERLAP_THRESHOLDS = np.linspace(0.0, 1.0, 21)
DISTANCE_THRESHOLDS = np.arange(51, dtype=np.float64)
NORMALISED_THRESHOLDS = np.linspace(0.0, 0.5, 51)
PRECISION_AT = 20
"""Distance in pixels of *the* precision figure."""
LOST_BELOW = 0.2
"""The object counts as lost in a frame where the overlap is smaller."""


@dataclass(frozen=True)
class Scores:
    """The figures of one track, or the means over several; each 0..1, NaN where undefined.

    Attributes:
        auc: area under the success curve, the mean over its 21 thresholds.
        precision: share of frames whose box centre lies within 20 pixels of the truth's.
        normalised_precision: area under the normalised precision curve, over 51 thresholds.
        ao: average overlap.
        sr50, sr75: share of frames with an overlap above 0.5, above 0.75.
        lost: share of frames with an overlap below `LOST_BELOW`, without the first frame.
        ends_lost: 1 where the last annotated frame is one of those, 0 where it is not; over
            several tracks, the share that ends lost.
    """

    auc: float
    precision: float
    normalised_precision: float
    ao: float
    sr50: float
    sr75: float
    lost: float
    ends_lost: float

    @classmethod
    def undefined(cls) -> Scores:
        """No figure at all."""
        return cls(**{f.name: float("nan") for f in fields(cls)})

    @classmethod
    def mean(cls, scores: list[Scores]) -> Scores:
        """The mean of each figure, every track weighing the same; undefined ones are left out."""
        return cls(**{f.name: _mean([getattr(s, f.name) for s in scores]) for f in fields(cls)})


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """How far a track is from the truth in each frame that counts.

    Attributes:
        frames: `[N]`, their indices.
        overlaps: `[N]`, 0..1; -1 where a frame counts and is compared with nothing (OTB's rules).
        distances: `[N]`, of the centres in pixels, infinite without a box; -1 likewise.
        normalised: `[N]`, the same in true widths and heights.
    """

    frames: NDArray[np.intp]
    overlaps: Floats
    distances: Floats
    normalised: Floats


def frame_errors(
    predicted_xywh: ArrayLike, truth_xywh: ArrayLike, *, otb_rules: bool = False
) -> FrameErrors:
    """Compare a track with its truth, frame by frame; arguments and errors as of `score`."""
    predicted, truth = with_given_frame(predicted_xywh, truth_xywh)
    frames = np.flatnonzero(np.isfinite(np.asarray(truth_xywh, dtype=np.float64)).all(axis=1))
    if otb_rules:
        return _otb_errors(np.asarray(predicted_xywh), np.asarray(truth_xywh), int(frames[0]))
    return FrameErrors(
        frames,
        overlap(predicted, truth),
        centre_distance(predicted, truth),
        normalised_distance(predicted, truth),
    )


def _otb_errors(predicted: Floats, truth: Floats, first: int) -> FrameErrors:
    """The same by the rules of OTB's toolkit, from the first annotated frame on."""
    predicted, truth = predicted[first:].astype(np.float64), truth[first:].astype(np.float64)
    predicted[0] = truth[0]
    for t in range(1, len(predicted)):
        box = predicted[t]
        missing = np.isnan(box).all() or box[2] <= 0 or box[3] <= 0
        if missing and not np.isnan(truth[t]).any():
            predicted[t] = predicted[t - 1]
    # In the toolkit's pixels, counted from 1; NaN is not above 0.
    compared = (truth + np.array([1.0, 1.0, 0.0, 0.0]) > 0).all(axis=1)
    frames = np.arange(first, first + len(truth))
    errors = (overlap, centre_distance, normalised_distance)
    return FrameErrors(
        frames, *(np.where(compared, error(predicted, truth), -1.0) for error in errors)
    )


def score(predicted_xywh: ArrayLike, truth_xywh: ArrayLike, *, otb_rules: bool = False) -> Scores:
    """All figures of one track.

    Args:
        predicted_xywh: `[T, 4]`; NaN where the tracker gave no box.
        truth_xywh: `[T, 4]`; NaN where there is no truth.
        otb_rules: count frames as OTB's toolkit does, see the head of this module. AO, SR.50 and
            SR.75, which it does not have, are then over the frames that are compared.

    Raises:
        ValueError: shapes differ or are not `[T, 4]`, or no frame has truth.
    """
    errors = frame_errors(predicted_xywh, truth_xywh, otb_rules=otb_rules)
    followed = errors.overlaps[1:]
    followed = followed[followed >= 0]
    return Scores(
        auc=float(success_curve(errors.overlaps).mean()),
        precision=float(precision_curve(errors.distances)[PRECISION_AT]),
        normalised_precision=float(normalised_precision_curve(errors.normalised).mean()),
        ao=_mean(followed),
        sr50=_mean(followed > 0.5),
        sr75=_mean(followed > 0.75),
        lost=_mean(followed < LOST_BELOW),
        ends_lost=_mean(followed[-1:] < LOST_BELOW),
    )


def with_given_frame(predicted_xywh: ArrayLike, truth_xywh: ArrayLike) -> tuple[Floats, Floats]:
    """Keep the annotated frames and set the first of them to the truth.

    Returns:
        predicted and truth, both `[N, 4]`, N the number of annotated frames; rows of `predicted`
        with any NaN or infinity are NaN throughout.

    Raises:
        ValueError: shapes differ or are not `[T, 4]`, or no frame has truth.
    """
    predicted = np.asarray(predicted_xywh, dtype=np.float64)
    truth = np.asarray(truth_xywh, dtype=np.float64)
    if predicted.shape != truth.shape or truth.ndim != 2 or truth.shape[1] != 4:
        raise ValueError(
            f"predicted boxes have shape {predicted.shape} and true ones {truth.shape}; expected "
            "[T, 4] for both: are they of the same clip?"
        )
    annotated = np.isfinite(truth).all(axis=1)
    if not annotated.any():
        raise ValueError("no frame has a true box; expected at least one to compare with")
    predicted, truth = predicted[annotated].copy(), truth[annotated]
    predicted[~np.isfinite(predicted).all(axis=1)] = np.nan
    predicted[0] = truth[0]
    return predicted, truth


def overlap(predicted_xywh: ArrayLike, truth_xywh: ArrayLike) -> Floats:
    """Intersection over union `[N]`, 0 where there is no predicted box."""
    return np.nan_to_num(iou_xywh(predicted_xywh, truth_xywh), nan=0.0)


def centre_distance(predicted_xywh: ArrayLike, truth_xywh: ArrayLike) -> Floats:
    """Distance of the boxes' centres in pixels `[N]`, infinite without a predicted box."""
    return _length(_centre_offset(predicted_xywh, truth_xywh))


def normalised_distance(predicted_xywh: ArrayLike, truth_xywh: ArrayLike) -> Floats:
    """Distance of centres `[N]`, measured across in true widths and down in true heights.

    As in TrackingNet (Müller et al., ECCV 2018).
    """
    size = np.asarray(truth_xywh, dtype=np.float64)[..., 2:]
    return _length(_centre_offset(predicted_xywh, truth_xywh) / size)


def success_curve(overlaps: ArrayLike) -> Floats:
    """Share of frames `[21]` whose overlap is above each of `OVERLAP_THRESHOLDS`."""
    return _share(np.asarray(overlaps)[:, None] > OVERLAP_THRESHOLDS)


def precision_curve(distances: ArrayLike) -> Floats:
    """Share of frames `[51]` whose distance is at most each of `DISTANCE_THRESHOLDS` pixels."""
    return _share(np.asarray(distances)[:, None] <= DISTANCE_THRESHOLDS)


def normalised_precision_curve(distances: ArrayLike) -> Floats:
    """Share of frames `[51]` with a normalised distance within `NORMALISED_THRESHOLDS`."""
    return _share(np.asarray(distances)[:, None] <= NORMALISED_THRESHOLDS)


def _centre_offset(predicted_xywh: ArrayLike, truth_xywh: ArrayLike) -> Floats:
    predicted = np.asarray(predicted_xywh, dtype=np.float64)
    truth = np.asarray(truth_xywh, dtype=np.float64)
    return (predicted - truth)[..., :2] + (predicted - truth)[..., 2:] / 2


def _length(offset: Floats) -> Floats:
    return np.nan_to_num(np.hypot(offset[..., 0], offset[..., 1]), nan=np.inf)


def _share(hits: NDArray[np.bool_]) -> Floats:
    return hits.mean(axis=0, dtype=np.float64)


def _mean(values: ArrayLike) -> float:
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    return float(known.mean()) if known.size else float("nan")
