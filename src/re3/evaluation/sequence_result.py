"""What one tracker gave on one sequence, and how good that is."""

from __future__ import annotations

from dataclasses import dataclass

from re3.data.sequence import Sequence
from re3.evaluation.metrics import FrameErrors, Scores, frame_errors, score
from re3.evaluation.one_pass import Track
from re3.evaluation.supervised import SupervisedTrack


@dataclass(frozen=True, eq=False)
class SequenceResult:
    """One tracker on one sequence.

    Attributes:
        tracker: its name.
        sequence: what it ran on.
        track: what it gave.
        scores: how good that is in one pass; undefined (NaN) where the tracker was started again,
            where the failure is not its own, and where no frame but that of the start has truth.
        reused: read back from an earlier run's files; its times are of that run.
        supervised: the same with the failures and restarts, where the protocol has them.
        repeat: which repetition of the run it is of, from 0.
        otb_rules: frames are counted as OTB's toolkit does.
    """

    tracker: str
    sequence: Sequence
    track: Track
    scores: Scores
    reused: bool = False
    supervised: SupervisedTrack | None = None
    repeat: int = 0
    otb_rules: bool = False

    @classmethod
    def of(
        cls,
        tracker: str,
        sequence: Sequence,
        given: Track | SupervisedTrack,
        reused: bool = False,
        repeat: int = 0,
        *,
        otb_rules: bool = False,
    ) -> SequenceResult:
        """The result of what a run gave, scored."""
        if isinstance(given, SupervisedTrack):
            track = given.as_track()
            return cls(tracker, sequence, track, Scores.undefined(), reused, given, repeat)
        if given.unscored or int(sequence.annotated.sum()) < 2:
            scores = Scores.undefined()
        else:
            scores = score(given.boxes_xywh, sequence.boxes_xywh, otb_rules=otb_rules)
        return cls(tracker, sequence, given, scores, reused, None, repeat, otb_rules)

    def errors(self) -> FrameErrors:
        """How far the track is from the truth, frame by frame; one with truth is needed."""
        return frame_errors(
            self.track.boxes_xywh, self.sequence.boxes_xywh, otb_rules=self.otb_rules
        )

    @property
    def comparable(self) -> bool:
        """There is truth beside the box that the tracker was given."""
        return int(self.sequence.annotated.sum()) > 1


Group = tuple[str, str]
"""Names of a dataset and a tracker."""


def grouped(results: list[SequenceResult]) -> dict[Group, list[SequenceResult]]:
    """The results of each dataset and tracker, in order of appearance."""
    groups: dict[Group, list[SequenceResult]] = {}
    for result in results:
        groups.setdefault((result.sequence.dataset, result.tracker), []).append(result)
    return groups
