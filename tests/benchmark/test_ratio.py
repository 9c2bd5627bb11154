"""re3-lite beside other trackers on the same frames: speed must not be lost unnoticed.

Ratios within rounds, so that a busy machine slows both; one thread each, so that a busy core does
not stall one of two. The margins let a ratio fall by a third before they fail: on a machine that
did other work as well it varied by a tenth from run to run.
"""

from pathlib import Path

import pytest

from re3.benchmark.contenders import Entry
from re3.benchmark.footage import made_footage
from re3.benchmark.measure import take_turns
from re3.evaluation.peers import available_trackers

PEER_FILES = Path(__file__).parents[3] / "shared" / "peers"

CSRT_AT_LEAST = 2.5
"""re3-lite took so many times less time than OpenCV's CSRT; see the head of the file."""
NANOTRACK_AT_LEAST = 0.5
"""And than NanoTrack v2 through OpenCV."""


def ratio_to(peer, files=None, rounds=7):
    """How many times as fast re3-lite is, one object, one thread."""
    entries = [
        Entry("re3-lite", True, "re3-lite", threads=1),
        Entry(peer, False, peer, threads=1, peer_files=files),
    ]
    contenders = {entry.name: entry.make() for entry in entries}
    found = take_turns(contenders, made_footage(40), rounds=rounds, frames=10)
    return found["re3-lite"].times_faster_than(found[peer])


def test_not_slower_than_it_was_beside_csrt():
    assert ratio_to("csrt") > CSRT_AT_LEAST


def test_not_slower_than_it_was_beside_nanotrack_v2():
    files = PEER_FILES if PEER_FILES.is_dir() else None
    (info,) = (each for each in available_trackers(files) if each.name == "nanotrack-v2")
    if info.missing is not None:
        pytest.skip(f"compares with NanoTrack v2: {info.missing}")
    assert ratio_to("nanotrack-v2", files) > NANOTRACK_AT_LEAST


def test_a_regression_to_half_the_speed_is_seen(monkeypatch):
    """The check itself: with each step run twice the ratio falls to about half."""
    import re3.benchmark.contenders as contenders

    plain = ratio_to("csrt", rounds=3)
    update = contenders.TimedMultiTracker.update

    def twice(self, frame):
        state = self.save_state()
        update(self, frame)
        self.load_state(state)
        return update(self, frame)

    monkeypatch.setattr(contenders.TimedMultiTracker, "update", twice)
    assert ratio_to("csrt", rounds=3) < 0.7 * plain
