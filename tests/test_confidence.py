"""Statuses: by the score, and by what it usually is."""

import numpy as np
import pytest

from re3.confidence import (
    FOUND_FROM,
    FOUND_SHARE,
    LOST_SHARE,
    SEARCH_SHARE,
    UNCERTAIN_SHARE,
    USUAL_AT_FIRST,
    USUAL_AT_LEAST,
    is_found,
    is_searched_for,
    status_of,
    usual_after,
)
from re3.result import Status


@pytest.mark.parametrize("usual", [USUAL_AT_FIRST, 0.9])
@pytest.mark.parametrize(
    ("share", "status"),
    [
        (1.0, Status.TRACKED),
        (UNCERTAIN_SHARE + 0.01, Status.TRACKED),
        (UNCERTAIN_SHARE - 0.01, Status.UNCERTAIN),
        (LOST_SHARE + 0.01, Status.UNCERTAIN),
        (LOST_SHARE - 0.01, Status.LOST),
        (0.0, Status.LOST),
        (np.nan, Status.TRACKED),  # a model without score
    ],
)
def test_status(usual, share, status):
    assert status_of(share * usual, usual) is status


def test_an_object_is_searched_for_before_it_is_lost():
    assert LOST_SHARE < SEARCH_SHARE < UNCERTAIN_SHARE
    assert is_searched_for(SEARCH_SHARE * 0.8 - 0.01, 0.8)
    assert not is_searched_for(SEARCH_SHARE * 0.8 + 0.01, 0.8)
    assert not is_searched_for(np.nan, 0.8)


def test_the_usual_score_follows_what_is_seen():
    usual = USUAL_AT_FIRST
    for _ in range(200):
        usual = usual_after(usual, 0.9)
    assert usual == pytest.approx(0.9, abs=0.01)
    for score in np.linspace(0.9, 0.5, 200):  # little by little
        usual = usual_after(usual, score)
    assert usual == USUAL_AT_LEAST  # no more than so far


def test_a_place_is_taken_near_the_usual_score_only():
    assert is_found(FOUND_FROM, USUAL_AT_LEAST)
    assert not is_found(FOUND_FROM - 0.01, USUAL_AT_LEAST)
    assert is_found(FOUND_SHARE * 0.9 + 0.01, 0.9)
    assert not is_found(FOUND_SHARE * 0.9 - 0.01, 0.9)
    assert not is_found(np.nan, 0.9)


@pytest.mark.parametrize("score", [0.1, SEARCH_SHARE * USUAL_AT_FIRST - 0.01, np.nan])
def test_the_usual_score_takes_no_note_of_frames_that_are_searched(score):
    usual = USUAL_AT_FIRST
    for _ in range(200):
        usual = usual_after(usual, score)
    assert usual == USUAL_AT_FIRST
