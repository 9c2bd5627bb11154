"""The figures of a phase: pairs a second, and where the time goes."""

import pytest

from re3.training import throughput
from re3.training.recipe import Phase
from re3.training.throughput import Meter, Stopwatch


def test_a_stopwatch_adds_up_by_part(monkeypatch):
    now = iter([0.0, 1.0, 10.0, 12.0, 20.0, 23.0])
    monkeypatch.setattr(throughput.time, "monotonic", lambda: next(now))
    watch = Stopwatch()
    for part in ("crops", "features", "crops"):
        with watch.time(part):
            pass
    assert watch.seconds == {"crops": 4.0, "features": 2.0}


def test_a_phase_comes_to_its_means_and_shares():
    meter, phase = Meter(), Phase(unroll=3, batch=5, own=0.0, iterations=2)
    meter.add({"clips": 0.5, "learn": 1.5})
    meter.add({"clips": 0.5, "learn": 0.5, "walk": 1.0})  # own predictions in one of both
    ended = meter.end(2, phase)
    assert ended.pairs_per_second == pytest.approx(2 * 5 * 4 / 4)
    assert ended.seconds == {"clips": 0.5, "learn": 1.0, "walk": 0.5}
    assert ended.shares == {"clips": 0.25, "learn": 0.5, "walk": 0.25}
    assert str(ended) == (
        "phase 3 (unroll 3, batch 5): 10.0 pairs/s over 2 iterations; "
        "clips 25.0%, learn 50.0%, walk 25.0%"
    )
    # The next phase begins from nothing.
    meter.add({"clips": 1.0})
    assert meter.end(3, phase).pairs_per_second == pytest.approx(20.0)
