import json

import numpy as np
import pytest
from rich.console import Console

from re3.evaluation.environment import Environment
from re3.evaluation.metrics import score
from re3.evaluation.one_pass import Track
from re3.evaluation.report import Report, remarks, summarise, to_json, to_markdown, to_tables
from re3.evaluation.runner import SequenceResult

BOX = (0.0, 0.0, 10.0, 10.0)
FAR = (500.0, 0.0, 10.0, 10.0)


@pytest.fixture
def report(sequence_of) -> Report:
    def result(tracker, dataset, name, boxes, seconds=0.01, failure=None, reused=False):
        sequence = sequences.setdefault(name, sequence_of([BOX] * len(boxes), name, dataset))
        track = Track(
            np.array(boxes), np.ones(len(boxes)), np.array([9.0, *[seconds] * (len(boxes) - 1)])
        )
        track = Track(track.boxes_xywh, track.scores, track.seconds, failure)
        scores = score(track.boxes_xywh, sequence.boxes_xywh)
        return SequenceResult(tracker, sequence, track, scores, reused)

    sequences = {}
    return Report(
        command="re3 eval data",
        data=("data/one", "data/two"),
        environment=Environment(
            cpu="Test CPU",
            cores=2,
            load=0.25,
            system="Linux x86_64",
            date="2024-05-06T07:08:09+00:00",
            versions={"re3": "1.2.3", "python": "3.11.0"},
        ),
        results=[
            result("good", "one", "a", [BOX, BOX]),
            result("bad", "one", "a", [BOX, FAR], 0.5),
            result("good", "one", "b", [BOX, FAR]),
            result("bad", "one", "b", [BOX, FAR], 0.5, "frame 1: update raised"),
            result("good", "two", "c", [BOX], reused=True),
            result("bad", "two", "c", [BOX]),
        ],
    )


def test_summary_is_the_mean_over_sequences(report):
    rows = summarise(report.results)
    assert [(r.dataset, r.tracker, r.sequences, r.failed, r.reused) for r in rows] == [
        ("one", "good", 2, 0, 0),
        ("one", "bad", 2, 1, 0),
        ("two", "good", 1, 0, 1),
        ("two", "bad", 1, 0, 0),
    ]
    assert rows[0].scores.auc == pytest.approx((20 / 21 + 10 / 21) / 2)
    assert rows[0].scores.precision == pytest.approx(0.75)
    assert (rows[0].fps, rows[1].fps) == (pytest.approx(100), pytest.approx(2))
    assert np.isnan(rows[2].fps)


def test_json_holds_everything_and_no_nan(report):
    document = json.loads(to_json(report), parse_constant=pytest.fail)
    assert document["command"] == "re3 eval data"
    assert document["data"] == ["data/one", "data/two"]
    assert document["environment"]["cpu"] == "Test CPU"
    assert document["environment"]["versions"]["re3"] == "1.2.3"
    assert len(document["summary"]) == 4
    assert len(document["sequences"]) == 6
    assert document["summary"][0]["auc"] == pytest.approx(15 / 21)
    assert document["summary"][2]["ao"] is None
    failed = document["sequences"][3]
    assert (failed["sequence"], failed["tracker"], failed["frames"]) == ("b", "bad", 2)
    assert failed["failure"] == "frame 1: update raised"


@pytest.mark.parametrize(
    "line",
    [
        "- command: `re3 eval data`",
        "- data: `data/one`, `data/two`",
        "- machine: Test CPU, 2 cores, Linux x86_64, load 0.2 before the run",
        "- date: 2024-05-06T07:08:09+00:00",
        "- versions: re3 1.2.3, python 3.11.0",
        "| one | good | 2 | 0.714 | 0.750 | 0.750 | 0.500 | 0.500 | 0.500 | 100 |  |",
        "| one | bad | 2 | 0.476 | 0.500 | 0.500 | 0.000 | 0.000 | 0.000 | 2.0 | 1 |",
        "| two | good | 1 | 0.952 | 1.000 | 1.000 | - | - | - | - |  |",
        "| dataset | sequence | frames | good | bad |",
        "| one | b | 2 | 0.476 | 0.476 x |",  # a failure is marked
        "| two | c | 1 | 1.000 | 1.000 |",
        "- bad failed on b, frame 1: update raised; the frames from there on count as missed",
    ],
)
def test_markdown(report, line):
    assert line in to_markdown(report).splitlines()


def test_tables_fit_a_narrow_terminal(report):
    tables = to_tables(report)
    # Two for the dataset with two sequences, one for the other.
    assert len(tables) == 3
    console = Console(width=80, force_terminal=False)
    with console.capture() as capture:
        for table in tables:
            console.print(table)
    text = capture.get()
    assert "one: 2 sequences" in text and "two: 1 sequence," in text
    for figure in ("0.714", "0.476 x", "SR.75", "100"):
        assert figure in text
    assert "…" not in text


def test_remarks_name_failures_and_reused_results(report):
    notes = remarks(report)
    assert len(notes) == 2
    assert notes[0].startswith("bad failed on b, frame 1")
    assert notes[1].startswith("1 of 1 sequences of good on two were taken")
