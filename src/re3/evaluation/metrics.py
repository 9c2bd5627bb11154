"""Success, precision and their relatives, for one track against its truth.

The measures of the one-pass evaluation (Wu, Lim, Yang: Online object tracking: a benchmark, CVPR
2013), with the conventions of its tool kit:

* The first annotated frame is where the tracker was given the truth. It counts, with the truth as
  the tracker's box, as in the OTB figures that trackers publish. AO, SR.50 and SR.75 are GOT-10k's
  and leave it out, as GOT-10k does.
* Frames without truth (NaN) are left out, whatever the tracker says there.
* A frame for which the tracker has no box (NaN) is one with overlap 0 and infinite distance.
* An overlap has to be above a threshold (`>`), a distance at or below it (`<=`).

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


def score(predicted_xywh: ArrayLike, truth_xywh: ArrayLike) -> Scores:
    """All figures of one track.

    Args:
        predicted_xywh: `[T, 4]`; NaN where the tracker gave no box.
        truth_xywh: `[T, 4]`; NaN where there is no truth.

    Raises:
        ValueError: shapes differ or are not `[T, 4]`, or no frame has truth.
    """
    predicted, truth = with_given_frame(predicted_xywh, truth_xywh)
    overlaps = overlap(predicted, truth)
    distances = centre_distance(predicted, truth)
    normalised = normalised_distance(predicted, truth)
    followed = overlaps[1:]
    return Scores(
        auc=float(success_curve(overlaps).mean()),
        precision=float(precision_curve(distances)[PRECISION_AT]),
        normalised_precision=float(normalised_precision_curve(normalised).mean()),
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
