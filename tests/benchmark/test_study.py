"""A study of made figures: what is left out, told and written."""

import json
import math

import numpy as np
import pytest

from re3.benchmark.advice import advice
from re3.benchmark.contenders import Entry
from re3.benchmark.footage import made_footage
from re3.benchmark.measure import Timing
from re3.benchmark.memory import Memory
from re3.benchmark.report import as_json, tables
from re3.benchmark.study import Plan, Study, run_study
from re3.evaluation.environment import Environment

HERE = Environment("a CPU", 2, 0.0, "Linux x86_64", "2026-01-01T00:00:00+00:00", {"re3": "0"})


def timing(objects, seconds, crop=math.nan, network=math.nan):
    shape = (2, 3)
    return Timing(objects, *(np.full(shape, value) for value in (seconds, crop, network)))


def study(entries, timings, **others):
    values = {
        "by_crop": {},
        "memory": {},
        "skipped": [],
        "environment": HERE,
        "footage": made_footage(2),
    }
    return Study(plan=Plan(entries, tuple(timings)), timings=timings, **{**values, **others})


OURS, ONE_THREAD, PEER = (
    Entry("ours", True, "re3-lite", threads=2),
    Entry("ours 1t", True, "re3-lite", threads=1),
    Entry("csrt", False, "csrt"),
)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        ({1: 0.01, 5: 0.02}, "30 FPS: ours follows all 5 objects measured"),
        ({1: 0.01, 2: 0.02, 10: 0.1}, "30 FPS: ours follows up to about 3 objects"),
        ({1: 0.08, 2: 0.09}, "a camera of 30 FPS is too fast for it: give it every 3. frame"),
    ],
)
def test_advice_on_a_camera(seconds, said):
    timings = {n: {"ours": timing(n, s, s / 4, s / 2)} for n, s in seconds.items()}
    told = advice(study([OURS], timings))
    assert said in told
    assert "an update is the network 50%, cutting crops 25%, the rest 25%" in told


def test_advice_prefers_fewer_threads_that_are_nearly_as_fast():
    def told(one_thread):
        found = {"ours": timing(1, 0.010), "ours 1t": timing(1, one_thread)}
        return [line for line in advice(study([OURS, ONE_THREAD], {1: found})) if "nearly" in line]

    assert told(0.011) == ["ours 1t is nearly as fast and leaves cores to the rest of your program"]
    assert told(0.014) == []


def test_advice_names_the_peers():
    found = {1: {"ours": timing(1, 0.010), "csrt": timing(1, 0.025)}}
    assert "ours is 2.50 times as fast as csrt with 1 object" in advice(study([OURS, PEER], found))
    found = {1: {"ours": timing(1, 0.025), "csrt": timing(1, 0.010)}}
    assert "ours is 2.50 times slower than csrt with 1 object" in advice(study([OURS, PEER], found))


def test_tables_and_json_hold_the_figures():
    made = study(
        [OURS, PEER],
        {1: {"ours": timing(1, 0.008, 0.001, 0.006), "csrt": timing(1, 0.04)}},
        by_crop={96: timing(1, 0.004, 0.001, 0.002)},
        memory={"ours": Memory(150_000_000, 90_000_000, 160_000_000)},
    )
    times, crops, sizes = tables(made)
    ours, csrt = ([cell.text for cell in row] for row in times.rows)
    assert ours == ["ours", "8.00", "8.00", "8.00", "125", "1.00", "6.00", "1.00", "1.00"]
    assert csrt == ["csrt", "40.0", "40.0", "40.0", "25.0", "-", "-", "-", "5.00"]
    assert [cell.text for cell in crops.rows[0]] == ["96 px", "4.00", "250", "1.00", "2.00"]
    assert [cell.text for cell in sizes.rows[0]][2:] == ["150", "60", "160"]
    written = json.loads(json.dumps(as_json(made), allow_nan=False))
    assert written["trackers"][0]["times"][0]["update"]["p50"] == 0.008
    assert written["trackers"][1]["times"][0]["network"]["p50"] is None
    assert written["crop_sizes"][0]["crop_size"] == 96


def test_the_plot_shows_every_contender(tmp_path):
    pytest.importorskip("matplotlib", reason="draws a plot")
    from re3.benchmark.plots import speed_plot
    from re3.evaluation.plots_style import save

    found = {n: {"ours": timing(n, 0.01 * n), "csrt": timing(n, 0.04 * n)} for n in (1, 2, 5)}
    made = study([OURS, PEER], found, by_crop={96: timing(1, 0.004), 192: timing(1, 0.008)})
    figure = speed_plot(made)
    objects, crops = figure.axes
    lines = {line.get_label(): line for line in objects.get_lines()}
    np.testing.assert_allclose(lines["ours"].get_ydata(), [100, 50, 20])
    np.testing.assert_allclose(lines["csrt"].get_ydata(), [25, 12.5, 5])
    np.testing.assert_allclose(crops.get_lines()[0].get_ydata(), [250, 125])
    assert save(figure, tmp_path / "speed.png").stat().st_size > 5000


def test_the_slow_are_not_given_more_objects(monkeypatch):
    def turns(contenders, footage, *, objects, **_):
        return {name: timing(objects, 0.3 * objects) for name in contenders}

    monkeypatch.setattr("re3.benchmark.study.take_turns", turns)
    plan = Plan([Entry("mosse", False, "mosse")], (1, 2, 5), memory=False)
    found = run_study(plan, made_footage(2))
    assert list(found.timings) == [1, 2]
    assert found.skipped == [
        "mosse is not measured with 5 objects: with fewer a frame took over 0.5 s"
    ]


def test_contenders_of_one_name_are_refused():
    with pytest.raises(ValueError, match="each with its own name"):
        run_study(Plan([PEER, PEER]), made_footage(2))
