"""Clips in which the object is painted over."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from re3.data.hiding import AFTER, LEAD, HiddenSequence, hide
from re3.data.sequence import Sequence

RANDOM = np.random.default_rng(0)
FRAMES = RANDOM.integers(0, 256, (60, 40, 60, 3)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Noise(Sequence):
    """A sequence that needs no file."""

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        yield from FRAMES[: len(self)]


@dataclass(frozen=True, eq=False)
class HiddenNoise(HiddenSequence, Noise):
    """The same, hidden."""


def boxes(count, absent=()):
    made = np.tile([10.0, 8.0, 20.0, 10.0], (count, 1))
    made[list(absent)] = np.nan
    return made


def test_the_object_is_painted_over_while_it_is_hidden_and_only_then():
    sequence = HiddenNoise.of(Noise("noise", Path("noise"), boxes(30), dataset="d"), 12, 17)
    for index, frame in enumerate(sequence.frames()):
        changed = (frame != FRAMES[index]).any(axis=2)
        if 12 <= index < 17:
            rows, columns = np.nonzero(changed)
            # A fifth of its side beyond the box: x 6 to 34, y 6 to 20.
            assert (columns.min(), columns.max()) == (6, 34)
            assert (rows.min(), rows.max()) == (6, 20)
            inside = frame[6:21, 6:35]
            np.testing.assert_array_equal(inside, FRAMES[0][::-1, ::-1][6:21, 6:35])
        else:
            assert not changed.any()
    assert sequence.occluded is not None
    assert np.flatnonzero(sequence.occluded).tolist() == [12, 13, 14, 15, 16]
    assert sequence.dataset == "d-hidden-5"


def test_every_sequence_is_hidden_for_every_duration_that_it_is_long_enough_for():
    long = Sequence("long", Path("long"), boxes(LEAD + 20 + AFTER + 1), dataset="d")
    short = Sequence("short", Path("short"), boxes(LEAD + 5 + AFTER + 1), dataset="d")
    gap = Sequence("gap", Path("gap"), boxes(80, absent=[LEAD + 12]), dataset="d")
    late = Sequence("late", Path("late"), boxes(4 + LEAD + 5 + AFTER + 1, range(4)), dataset="d")
    found = [(s.name, s.hidden_from, s.hidden_to) for s in hide([long, short, gap, late], (5, 20))]
    assert found == [
        ("long", LEAD, LEAD + 5),
        ("short", LEAD, LEAD + 5),
        ("late", 4 + LEAD, 4 + LEAD + 5),
        ("long", LEAD, LEAD + 20),
    ]


def test_nothing_to_hide_is_said():
    with pytest.raises(ValueError, match=r"none of the 1 sequences can be hidden: expected 10"):
        hide([Sequence("s", Path("s"), boxes(12))])


@pytest.mark.parametrize(
    ("start", "end", "message"),
    [(5, 5, "has 12"), (8, 13, "has 12"), (2, 6, "not annotated in all of them")],
)
def test_frames_that_cannot_be_hidden_are_refused(start, end, message):
    with pytest.raises(ValueError, match=message):
        HiddenSequence.of(Sequence("s", Path("s"), boxes(12, absent=[3])), start, end)
