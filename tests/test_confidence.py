"""Statuses: by the score, and by what it usually is."""

import numpy as np
import pytest

from re3.confidence import (
    FOUND_FROM,
    FOUND_SHARE,
    LOST_AT_ONCE_SHARE,
    LOST_FRAMES,
    LOST_SHARE,
    RECENT_AT_LEAST,
    SEARCH_SHARE,
    UNCERTAIN_SHARE,
    USUAL_AT_FIRST,
    USUAL_AT_LEAST,
    ScoreMemory,
    is_found,
    is_searched_for,
)
from re3.result import Status

T, U, L = Status.TRACKED, Status.UNCERTAIN, Status.LOST


def statuses(scores, memory=None):
    memory, found = memory or ScoreMemory(), []
    for score in scores:
        found.append(memory.status(score))
        memory = memory.after(score)
    return found


@pytest.mark.parametrize("usual", [USUAL_AT_FIRST, 0.9])
@pytest.mark.parametrize(
    ("share", "status"),
    [
        (1.0, T),
        (UNCERTAIN_SHARE + 0.01, T),
        (UNCERTAIN_SHARE - 0.01, U),
        (LOST_AT_ONCE_SHARE + 0.01, U),
        (LOST_AT_ONCE_SHARE - 0.01, L),
        (0.0, L),
        (np.nan, T),  # a model without score
    ],
)
def test_status(usual, share, status):
    assert ScoreMemory(usual, usual).status(share * usual) is status


def test_what_is_low_for_long_is_lost_until_it_is_tracked_again():
    assert LOST_FRAMES == 2
    assert statuses([0.75, 0.5, 0.75, 0.5, 0.5, 0.54, 0.75, 0.5]) == [T, U, T, U, L, L, T, U]


def test_what_falls_little_by_little_is_uncertain_and_not_lost():
    found = statuses(np.linspace(0.8, 0.4, 60))
    assert found[0] is T
    assert found[-1] is U
    assert L not in found


def test_however_little_was_scored_lately_a_low_score_is_lost():
    memory = ScoreMemory()
    for _ in range(200):
        memory = memory.after(0.36)
        memory = memory.after(0.54)
    assert memory.recent >= RECENT_AT_LEAST
    assert statuses([LOST_SHARE * RECENT_AT_LEAST - 0.01] * 2, memory)[-1] is L


def test_a_model_without_score_is_never_lost():
    assert statuses([np.nan] * 5) == [T] * 5


def test_an_object_is_searched_for_before_it_is_lost():
    assert LOST_AT_ONCE_SHARE < LOST_SHARE <= SEARCH_SHARE < UNCERTAIN_SHARE
    assert is_searched_for(SEARCH_SHARE * 0.8 - 0.01, 0.8)
    assert not is_searched_for(SEARCH_SHARE * 0.8 + 0.01, 0.8)
    assert not is_searched_for(np.nan, 0.8)


def test_the_usual_score_follows_what_is_seen():
    memory = ScoreMemory()
    for _ in range(200):
        memory = memory.after(0.9)
    assert memory.usual == pytest.approx(0.9, abs=0.01)
    assert memory.recent == pytest.approx(0.9, abs=0.01)
    for score in np.linspace(0.9, 0.5, 200):  # little by little
        memory = memory.after(score)
    assert memory.usual == USUAL_AT_LEAST  # no more than so far
    assert memory.recent == pytest.approx(0.5, abs=0.05)


def test_a_place_is_taken_near_the_usual_score_only():
    assert is_found(FOUND_FROM, USUAL_AT_LEAST)
    assert not is_found(FOUND_FROM - 0.01, USUAL_AT_LEAST)
    assert is_found(FOUND_SHARE * 0.9 + 0.01, 0.9)
    assert not is_found(FOUND_SHARE * 0.9 - 0.01, 0.9)
    assert not is_found(np.nan, 0.9)


@pytest.mark.parametrize("score", [0.1, SEARCH_SHARE * USUAL_AT_FIRST - 0.01, np.nan])
def test_the_usual_score_takes_no_note_of_frames_that_are_searched(score):
    memory = ScoreMemory()
    for _ in range(200):
        memory = memory.after(score)
    assert memory.usual == USUAL_AT_FIRST
