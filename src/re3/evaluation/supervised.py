"""Supervised evaluation: a tracker that has lost the object is started again.

The experiment of the VOT challenges (Kristan et al.: A novel performance evaluation methodology
for single-target trackers, TPAMI 2016) and of Re3's ablation study (Re3, Table I). A tracker has
failed in a frame where its box and the truth no longer overlap. It is then started again with the
truth, some frames later: five in VOT, the next in `re3.evaluation.ablation`.

What comes out is a trajectory as the VOT toolkit keeps them: a box in each frame, or a code that
says that the tracker was started there, failed there, or was not asked.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from re3.data.sequence import Sequence
from re3.evaluation.frame_log import FrameLog, Step
from re3.evaluation.metrics import overlap
from re3.evaluation.one_pass import (
    Track,
    TrackerFailure,
    close,
    first_annotated,
    follow,
    start,
    timed_frames,
)
from re3.evaluation.peers import SequenceTracker, TrackerFactory
from re3.evaluation.vot_overlap import pixel_overlaps
from re3.timed_tracker import time_spent

_NAN = float("nan")

__all__ = ["VOT", "Step", "SupervisedConfig", "SupervisedTrack", "run_supervised"]


@dataclass(frozen=True)
class SupervisedConfig:
    """When a tracker has failed and when it is started again.

    Attributes:
        restart_after: frames from a failure to the next start; 1 is the next frame. Where the
            object has no box there, the first later frame in which it has one.
        fails_at: a box that overlaps the truth by no more than this has failed, 0..1.
        grace: so many frames from a restart on, the restart itself included, no failure is looked
            for; after the first start there is none.
        wait_for_sight: never start again in a frame marked as occluded. The VOT toolkit can do
            that (`skip_tags`); its stacks of VOT 2014, 2016 and 2018 do not.
        by_pixels: overlap is counted in whole pixels inside the frame, as VOT's toolkit counts it
            (`re3.evaluation.vot_overlap`), with the truth's polygon where it has one; else it is
            the exact overlap with the truth's upright box.
    """

    restart_after: int = 5
    fails_at: float = 0.0
    grace: int = 0
    wait_for_sight: bool = False
    by_pixels: bool = False

    def __post_init__(self) -> None:
        if self.restart_after < 1:
            raise ValueError(
                f"restart_after is {self.restart_after}; expected 1 (the next frame) or more"
            )
        if not 0.0 <= self.fails_at < 1.0:
            raise ValueError(f"fails_at is {self.fails_at}; expected an overlap from 0 to below 1")
        if self.grace < 0:
            raise ValueError(f"grace is {self.grace} frames; expected 0 or more")


VOT = SupervisedConfig(by_pixels=True)
"""The supervised experiment of VOT 2014 to 2018."""


@dataclass(frozen=True, eq=False)
class SupervisedTrack:
    """What a tracker gave for one sequence, started again whenever it failed.

    Attributes:
        boxes_xywh: float64 `[T, 4]` in pixels, NaN where the frame was not followed; the truth
            where the tracker was started.
        steps: int8 `[T]` of `Step`. Frames before the first annotated one, between a failure and
            the next start, and after a crash are skipped.
        seconds: `[T]`, time in the tracker; NaN where it was skipped. That of a failed frame
            counts, the tracker ran there.
        failure: why the run stopped before the end, with the frame: the tracker crashed, or the
            frames could not be read. None where it did not, however often the object was lost.
        scores: `[T]`, the tracker's own; NaN where the frame was neither followed nor started.
        decode_seconds: `[T]`, time to read each frame; NaN where it was not measured.
        unscored: the failure is not the tracker's: frames that cannot be read.
        crop_seconds, network_seconds: as of `re3.evaluation.one_pass.Track`.
    """

    boxes_xywh: NDArray[np.float64]
    steps: NDArray[np.int8]
    seconds: NDArray[np.float64]
    failure: str | None = None
    scores: NDArray[np.float64] | None = None
    decode_seconds: NDArray[np.float64] | None = None
    unscored: bool = False
    crop_seconds: NDArray[np.float64] | None = None
    network_seconds: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        count = len(self.boxes_xywh)
        shapes = (np.shape(self.boxes_xywh), np.shape(self.steps), np.shape(self.seconds))
        if shapes != ((count, 4), (count,), (count,)):
            raise ValueError(
                f"boxes, steps and seconds have shapes {shapes}; expected [T, 4], [T] and [T]"
            )

    @classmethod
    def of(
        cls, log: FrameLog, failure: str | None = None, unscored: bool = False
    ) -> SupervisedTrack:
        """The track of a log."""
        return cls(
            log.boxes_xywh,
            log.steps,
            log.seconds,
            failure,
            log.scores,
            log.decode_seconds,
            unscored,
            log.crop_seconds,
            log.network_seconds,
        )

    @property
    def drops(self) -> int:
        """How often the object was lost."""
        return int((self.steps == Step.FAILED).sum())

    def as_track(self) -> Track:
        """The boxes and times alone; the times of starts are left out but for the first."""
        seconds = self.seconds.copy()
        seconds[np.flatnonzero(self.steps == Step.STARTED)[1:]] = np.nan
        scores = np.full(len(seconds), np.nan) if self.scores is None else self.scores
        return Track(
            self.boxes_xywh,
            scores,
            seconds,
            self.failure,
            self.decode_seconds,
            self.unscored,
            self.crop_seconds,
            self.network_seconds,
        )


def run_supervised(
    tracker_factory: TrackerFactory,
    sequence: Sequence,
    config: SupervisedConfig = VOT,
    on_frame: Callable[[int], None] | None = None,
    log: FrameLog | None = None,
) -> SupervisedTrack:
    """Run a tracker over a sequence, starting a fresh one whenever the last has lost the object.

    In frames without truth the tracker follows, and nobody can say that it has failed.

    Args:
        tracker_factory: makes a tracker for each start.
        sequence: with at least one annotated frame.
        config: when it has failed and when it starts again.
        on_frame: called with the number of frames done, after each.
        log: what the frames are noted in; one of its own by default.

    Returns:
        the track. A tracker that raises, or gives a box that is not four finite numbers, is not
        started again: that frame has failed, those after it are skipped, and the track says why.

    Raises:
        ValueError: the sequence has no annotated frame.
        re3.evaluation.one_pass.UnreadableFrames: its frames cannot be read; a ValueError too.
        Whatever the factory raises.
    """
    next_start = first_annotated(sequence)
    log = FrameLog(len(sequence), on_frame=on_frame) if log is None else log
    startable = sequence.annotated.copy()
    if config.wait_for_sight and sequence.occluded is not None:
        startable &= ~sequence.occluded
    startable[next_start] = True
    tracker: SequenceTracker | None = None
    failed_before, judged_from = False, 0
    try:
        for index, (frame, decoded_in) in enumerate(timed_frames(sequence)):
            truth = sequence.boxes_xywh[index]
            starting = tracker is None
            if tracker is None:
                if index < next_start or not startable[index]:
                    log.add(index, Step.SKIPPED, decode_seconds=decoded_in)
                    continue
                tracker = tracker_factory()
                judged_from = index + (config.grace if failed_before else 0)
            started = time.perf_counter()
            try:
                if starting:
                    start(tracker, frame, truth)
                    box, score, step = truth, 1.0, Step.STARTED
                else:
                    box, score = follow(tracker, frame)
                    step = Step.FOLLOWED
            except TrackerFailure as error:
                log.add(index, Step.FAILED, decode_seconds=decoded_in)
                return SupervisedTrack.of(log, f"frame {index}: {error}")
            seconds = time.perf_counter() - started
            judged = sequence.annotated[index] and index >= judged_from and not starting
            if judged and _overlap(sequence, index, box, frame, config) <= config.fails_at:
                log.add(index, Step.FAILED, None, _NAN, seconds, decoded_in, *time_spent(tracker))
                close(tracker)
                tracker, failed_before = None, True
                next_start = index + config.restart_after
                continue
            log.add(index, step, box, score, seconds, decoded_in, *time_spent(tracker))
    finally:
        if tracker is not None:
            close(tracker)
    return SupervisedTrack.of(log)


def _overlap(
    sequence: Sequence,
    index: int,
    box_xywh: NDArray[np.float64],
    frame: NDArray[np.uint8],
    config: SupervisedConfig,
) -> float:
    """Overlap of a box with the truth of a frame."""
    truth = sequence.boxes_xywh[index]
    if not config.by_pixels:
        return float(overlap(box_xywh, truth))
    polygon = None if sequence.polygons is None else sequence.polygons[index]
    height, width = frame.shape[:2]
    return float(pixel_overlaps([box_xywh], [truth], (width, height), [polygon])[0])
