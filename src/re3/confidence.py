"""From scores to statuses: what a score means depends on what the object's score usually is.

Some objects are scored .9 as long as all is well, others, that bend or are small, .6. One threshold
for both calls the second lost when it is not, or the first tracked when it is not.
"""

from __future__ import annotations

from re3.result import Status

USUAL_AT_FIRST = 0.75
"""Taken for an object's usual score before any was seen."""

USUAL_AT_LEAST = 0.65
"""What is usual is never less: boxes that creep off an object are scored lower and lower, too."""

RATE = 0.05
"""Share of a new score in the usual one."""

UNCERTAIN_SHARE = 0.75
SEARCH_SHARE = 0.7
LOST_SHARE = 0.55
"""Shares of the usual score below which a box is uncertain, the object is searched for, and it is
lost. Chosen, with the two values above, from what `benchmarks/score.py` prints on val, with objects
hidden for 20 frames and without: docs/experiments.md. A box that is not called lost may well be."""

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


def status_of(score: float, usual: float = USUAL_AT_FIRST) -> Status:
    """Status of a box by its score; `TRACKED` for a model without score (NaN).

    Args:
        score: of the box, expected overlap in 0..1.
        usual: what the object's score usually is, see `usual_after`.
    """
    if score < LOST_SHARE * usual:
        return Status.LOST
    return Status.UNCERTAIN if score < UNCERTAIN_SHARE * usual else Status.TRACKED


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


def usual_after(usual: float, score: float) -> float:
    """What the score usually is, after one more: a mean that forgets.

    Frames in which the object is searched for do not count, or any box would do after a while.
    """
    if score >= SEARCH_SHARE * usual:
        return max((1 - RATE) * usual + RATE * score, USUAL_AT_LEAST)
    return usual
