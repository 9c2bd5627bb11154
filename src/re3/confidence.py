"""From scores to statuses: what a score means depends on what the object's score usually is.

Some objects are scored .9 as long as all is well, others, that bend or are small, .6. One threshold
for both calls the second lost when it is not, or the first tracked when it is not.
"""

from __future__ import annotations

from dataclasses import dataclass

from re3.result import Status

USUAL_AT_FIRST = 0.75
"""Taken for an object's usual score before any was seen."""

USUAL_AT_LEAST = 0.65
"""What is usual is never less: boxes that creep off an object are scored lower and lower, too."""

RATE = 0.05
"""Share of a new score in the usual one."""

UNCERTAIN_SHARE, SEARCH_SHARE = 0.75, 0.7
"""Shares of the usual score below which a box is uncertain, and the object is searched for."""

RECENT_RATE, RECENT_AT_LEAST = 0.2, 0.5
"""Share of a new score in the recent one, a mean of the last few frames, and the least it can be:
what is lost falls from one frame to the next, while objects that bend or turn are scored lower for
a while."""

LOST_SHARE, LOST_FRAMES = 0.7, 2
"""An uncertain box below that share of the recent score, for so many frames on end, is lost."""

LOST_AT_ONCE_SHARE = 0.45
"""Below that share it is lost in the first of them. All these values were chosen from what
`benchmarks/score.py` prints on val, with objects hidden and without: docs/experiments.md. A box
that is not called lost may well be."""

SIDES_CHANGE = 1.5
"""As long as it is uncertain or lost, a box has sides of at most so many times, and at least that
part of, what they were when it was last tracked: boxes without an object would grow over the whole
frame, and then the object is a speck in the crop when it comes back. Chosen on val."""

FOUND_FROM, FOUND_SHARE = 0.6, 0.85
"""A place that a search comes past is taken where its score is the first or more, and that share of
the usual score or more: after a long search, somebody else is found otherwise. Chosen on val."""

DOUBTED_FRAMES, DOUBT_MARGIN = 30, 0.1
"""For so many frames after a search, what is followed may be somebody else who stood by: where its
score is below the usual one, the place that the object was lost at is looked at as well, and taken
where the score there is higher by the second. Chosen on val: docs/experiments.md."""


@dataclass(frozen=True)
class ScoreMemory:
    """What is remembered of an object's scores, which are expected overlaps in 0..1.

    Attributes:
        usual: a mean of its scores that forgets slowly.
        recent: one that forgets fast.
        low_frames: on end, up to now, with a score below `LOST_SHARE` of the recent one.
        lost: whether its last box was.
    """

    usual: float = USUAL_AT_FIRST
    recent: float = USUAL_AT_FIRST
    low_frames: int = 0
    lost: bool = False

    def status(self, score: float) -> Status:
        """Of the next box; `TRACKED` for a model without score (NaN).

        Args:
            score: of the box, expected overlap in 0..1.
        """
        if not score < UNCERTAIN_SHARE * self.usual:
            return Status.TRACKED
        lasting = score < LOST_SHARE * self.recent and self.low_frames + 1 >= LOST_FRAMES
        at_once = score < LOST_AT_ONCE_SHARE * self.recent
        return Status.LOST if self.lost or lasting or at_once else Status.UNCERTAIN

    def after(self, score: float) -> ScoreMemory:
        """What is remembered after one more score.

        Frames in which the object is searched for do not count as usual, or any box would do after
        a while.
        """
        usual, recent = self.usual, self.recent
        low = score < LOST_SHARE * recent
        if score >= SEARCH_SHARE * usual:
            usual = max((1 - RATE) * usual + RATE * score, USUAL_AT_LEAST)
        if score >= LOST_SHARE * recent:
            recent = max((1 - RECENT_RATE) * recent + RECENT_RATE * score, RECENT_AT_LEAST)
        lost = self.status(score) is Status.LOST
        return ScoreMemory(usual, recent, self.low_frames + 1 if low else 0, lost)


def is_searched_for(score: float, usual: float) -> bool:
    """Whether an object is looked for at other places."""
    return score < SEARCH_SHARE * usual


def is_found(score: float, usual: float) -> bool:
    """Whether a place that a search comes past is the object's, by its score there."""
    return score >= max(FOUND_FROM, FOUND_SHARE * usual)


def is_doubted(score: float, usual: float, doubted_frames: int) -> bool:
    """Whether the place that an object was lost at is looked at, though it is not searched for.

    Args:
        score: of the box.
        usual: what the object's score usually is.
        doubted_frames: left of `DOUBTED_FRAMES` since the last search.
    """
    return doubted_frames > 0 and SEARCH_SHARE * usual <= score < usual
