"""Expected average overlap: how well an object is followed for so many frames.

Kristan et al.: The Visual Object Tracking VOT2015 challenge results, ICCVW 2015, as vot-toolkit
0.9.0 computes it.

* Every run is cut into fragments, from each start to the frame before the failure, and one from the
  last start to the end. A fragment that ended in a failure goes on for ever with overlap 0; one
  that reached the end counts up to its length only. The curve's value at t is the mean over
  fragments of their mean overlap over frames 1..t after the start (frame 0, the start, has none).
* The expected overlap on occluded frames is that of the challenges' MATLAB toolkit
  (`estimate_expected_overlap` with the label `occlusion`): the same fragments, each weighted by the
  share of its frames that are marked, from its start up to the next one. Of a run without a failure
  only the frames up to `high` are looked at. 0.9.0 has no such analysis.
"""

from __future__ import annotations

from collections.abc import Sequence as List
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from re3.evaluation.supervised import Step, SupervisedTrack

if TYPE_CHECKING:
    from re3.evaluation.vot import VotRuns

Floats = NDArray[np.float64]


def expected_overlap_curve(sequences: List[VotRuns], occluded_up_to: int | None = None) -> Floats:
    """The expected average overlap after t frames, `[L]`, L the length of the longest fragment.

    The toolkit sums in float32; this in float64, and they differ by about 1e-7.

    Args:
        sequences: runs on each.
        occluded_up_to: of occluded frames: fragments count by their share of marked frames, of a
            run without a failure by that of the frames up to this one. None: all count alike.

    Returns:
        the curve; empty without a fragment, NaN where all that are as long have the weight 0.
    """
    fragments: list[_Fragment] = []
    for sequence in sequences:
        for run, overlaps in zip(sequence.runs, sequence.overlaps, strict=True):
            fragments += _cut(run, overlaps, sequence.occluded, occluded_up_to)
    if not fragments:
        return np.empty(0)
    lengths = np.array([len(fragment.overlaps) for fragment in fragments])
    columns = np.arange(lengths.max())
    inside = columns < lengths[:, None]
    table = np.zeros(inside.shape)
    table[inside] = np.concatenate([fragment.overlaps for fragment in fragments])
    # Frame 0 is that of the start: its overlap is 0, and the means are over the frames after it.
    means = np.cumsum(table, axis=1) / np.maximum(columns, 1)
    counts = inside | np.array([fragment.lost for fragment in fragments])[:, None]
    weights = counts * np.array([fragment.weight for fragment in fragments])[:, None]
    total = weights.sum(axis=0)
    unknown = np.full(len(total), np.nan)
    return np.divide((means * weights).sum(axis=0), total, out=unknown, where=total > 0)


@dataclass(frozen=True, eq=False)
class _Fragment:
    """A stretch of a run, from a start to the frame before a failure or to the end.

    Attributes:
        overlaps: of its frames, those without truth left out.
        lost: it ended in a failure.
        weight: how much it counts.
    """

    overlaps: Floats
    lost: bool
    weight: float


def _cut(
    run: SupervisedTrack,
    overlaps: Floats,
    occluded: NDArray[np.bool_] | None,
    occluded_up_to: int | None,
) -> list[_Fragment]:
    """The fragments of a run; of the last two arguments see `expected_overlap_curve`."""
    starts = np.flatnonzero(run.steps == Step.STARTED)
    ends = np.flatnonzero(run.steps == Step.FAILED)
    # A tracker that crashed as it was started failed in a frame without start.
    if len(ends) > len(starts):
        starts = np.sort(np.append(starts, ends[-1]))
    fragments = []
    for number, start in enumerate(starts):
        failed = number < len(ends)
        overlap = overlaps[start : ends[number] if failed else len(overlaps)]
        weight = 1.0
        if occluded_up_to is not None:
            # The next start belongs to it, as in the toolkit.
            until = starts[number + 1] + 1 if number + 1 < len(starts) else len(overlaps)
            if not len(ends):
                until = min(until, start + occluded_up_to)
            weight = 0.0 if occluded is None else float(occluded[start:until].mean())
        fragments.append(_Fragment(overlap[~np.isnan(overlap)], failed, weight))
    return fragments
