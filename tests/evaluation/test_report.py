"""The figures of a run as text: Markdown, JSON, CSV, and tables for a terminal."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from re3.apps.evaluate_tables import console_tables
from re3.data.sequence import Sequence
from re3.evaluation.environment import Environment
from re3.evaluation.one_pass import Track
from re3.evaluation.protocols import find_protocol
from re3.evaluation.report_data import results_csv, results_json
from re3.evaluation.report_markdown import to_markdown
from re3.evaluation.report_tables import sequence_tables, speed, speed_tables, summary_table
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.summary import Run, notes
from re3.evaluation.supervised import Step, SupervisedTrack

BOX = (0.0, 0.0, 10.0, 10.0)
FAR = (500.0, 0.0, 10.0, 10.0)
NAN = (np.nan,) * 4
STEPS = {"f": Step.FOLLOWED, "S": Step.STARTED, "X": Step.FAILED, "-": Step.SKIPPED}


def one_pass(tracker, sequence, boxes, seconds=0.01, failure=None, reused=False, repeat=0):
    times = np.array([9.0, *[seconds] * (len(boxes) - 1)])
    decoding = np.full(len(boxes), 0.002)
    track = Track(np.array(boxes), np.ones(len(boxes)), times, failure, decoding)
    return SequenceResult.of(tracker, sequence, track, reused, repeat)


def restarted(tracker, sequence, steps, seconds=0.01):
    """A result with restarts: a letter a frame; where it followed, it was right."""
    boxes = np.array([BOX if letter in "fS" else NAN for letter in steps])
    codes = np.array([STEPS[letter] for letter in steps], np.int8)
    track = SupervisedTrack(boxes, codes, np.full(len(steps), seconds))
    return SequenceResult.of(tracker, sequence, track)


def run_of(results, protocol="ope", jobs=1, stack="vot2016") -> Run:
    return Run(
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
        protocol=find_protocol(protocol, stack),
        jobs=jobs,
        results=results,
    )


@pytest.fixture
def run(sequence_of) -> Run:
    a, b = (sequence_of([BOX] * 2, name, "one") for name in "ab")
    c = sequence_of([BOX], "c", "two")
    return run_of(
        [
            one_pass("good", a, [BOX, BOX]),
            one_pass("bad", a, [BOX, FAR], 0.5),
            one_pass("good", b, [BOX, FAR]),
            one_pass("bad", b, [BOX, FAR], 0.5, "frame 1: update raised"),
            one_pass("good", c, [BOX], reused=True),
            one_pass("bad", c, [BOX]),
        ]
    )


@pytest.fixture
def restarts(tmp_path) -> list[SequenceResult]:
    """Two sequences of 40 frames: `lost` fails once in the second."""
    folder = tmp_path / "frames"
    folder.mkdir()
    # The VOT protocol asks how large the frames are.
    cv2.imwrite(str(folder / "0.png"), np.zeros((100, 100, 3), np.uint8))
    first, second = (
        Sequence(name, Path(folder), np.array([BOX] * 40), dataset="made") for name in ("x", "y")
    )
    steps = "S" + "f" * 19 + "X----S" + "f" * 14
    return [
        restarted("steady", first, "S" + "f" * 39),
        restarted("lost", first, "S" + "f" * 39, 0.002),
        restarted("steady", second, "S" + "f" * 39),
        restarted("lost", second, steps, 0.002),
    ]


def cells(table, row):
    return [cell.text for cell in table.rows[row]]


def marks(table, heading):
    column = table.header.index(heading)
    return [row[column].mark for row in table.rows]


def test_a_row_is_the_mean_over_sequences(run):
    rows = run.tracker_rows
    assert [(r.dataset, r.tracker, r.sequences, r.failed) for r in rows] == [
        ("one", "good", 2, 0),
        ("one", "bad", 2, 1),
        ("two", "good", 1, 0),
        ("two", "bad", 1, 0),
    ]
    figures = rows[0].figures.mean
    assert figures["auc"] == pytest.approx((20 / 21 + 10 / 21) / 2)
    assert figures["precision"] == pytest.approx(0.75)
    assert (rows[0].fps, rows[1].fps) == (pytest.approx(100), pytest.approx(2))
    assert np.isnan(rows[2].fps)


def test_json_holds_everything_and_no_nan(run):
    document = json.loads(results_json(run), parse_constant=pytest.fail)
    assert document["command"] == "re3 eval data"
    assert document["data"] == ["data/one", "data/two"]
    assert (document["protocol"], document["jobs"]) == ("ope", 1)
    assert document["environment"]["versions"]["re3"] == "1.2.3"
    assert len(document["summary"]) == 4
    assert len(document["sequences"]) == 6
    first, third = document["summary"][0], document["summary"][2]
    assert first["figures"]["auc"] == pytest.approx(15 / 21)
    assert first["latency_seconds"] == pytest.approx({"p50": 0.01, "p95": 0.01, "p99": 0.01})
    assert first["decode_seconds"] == pytest.approx(0.002)
    assert third["figures"]["ao"] is None and third["fps"] is None
    failed = document["sequences"][3]
    assert (failed["sequence"], failed["tracker"], failed["frames"]) == ("b", "bad", 2)
    assert failed["failure"] == "frame 1: update raised"


def test_csv_has_a_line_a_run_and_nothing_where_undefined(run):
    rows = list(csv.DictReader(results_csv(run).splitlines()))
    assert [(row["sequence"], row["tracker"]) for row in rows[:2]] == [("a", "good"), ("a", "bad")]
    assert float(rows[0]["auc"]) == pytest.approx(20 / 21)
    assert float(rows[0]["fps"]) == pytest.approx(100)
    assert float(rows[0]["decode_seconds"]) == pytest.approx(0.002)
    assert (rows[4]["ao"], rows[4]["fps"], rows[4]["repeat"]) == ("", "", "1")


def test_the_length_of_a_sequence_is_not_the_number_of_annotated_frames(sequence_of):
    sequence = sequence_of([BOX, NAN, BOX])
    (row,) = csv.DictReader(
        results_csv(run_of([restarted("t", sequence, "Sff")], "ablation")).splitlines()
    )
    assert (row["frames"], row["drops"], row["accuracy"]) == ("3", "0.0", "1.0")


@pytest.mark.parametrize(
    "line",
    [
        "# One-pass evaluation",
        "- command: `re3 eval data`",
        "- data: `data/one`, `data/two`",
        "- machine: Test CPU, 2 cores, Linux x86_64, load 0.2 before the run",
        "- sequences at the same time: 1",
        "- date: 2024-05-06T07:08:09+00:00",
        "- versions: re3 1.2.3, python 3.11.0",
        "## one: 2 sequences, ope",
        "| tracker | AUC | P@20 | NP | AO | SR.50 | SR.75 | FPS | p95 ms | failed |",
        "| good | 0.714 | 0.750 | 0.750 | 0.500 | 0.500 | 0.500 | 100 | 10.0 |  |",
        "| bad | 0.476 | 0.500 | 0.500 | 0.000 | 0.000 | 0.000 | 2.0 | 500.0 | 1 |",
        "| tracker | p50 ms | p95 ms | p99 ms | reading ms |",
        "| bad | 500.0 | 500.0 | 500.0 | 2.0 |",
        "### AUC by sequence",
        "### P@20 by sequence",
        "| sequence | frames | good | bad |",
        "| b | 2 | 0.476 | 0.476 x |",  # a failure is marked
        "## two: 1 sequence, ope",
        "| good | - | - | - | - | - | - | - | - |",  # nobody failed, no column
        "| c | 1 | - | - |",  # nothing to compare with beside the box given
        "- bad failed on b, frame 1: update raised; the frames from there on count as missed",
    ],
)
def test_markdown(run, line):
    assert line in to_markdown(run).splitlines()


def test_a_bar_in_a_name_does_not_split_a_markdown_row(run):
    result = replace(run.results[0], tracker="a|b")
    assert "\n| a\\|b | 0.952 |" in to_markdown(replace(run, results=[result]))


def test_the_ablation_study_has_its_own_figures(restarts):
    run = run_of(restarts, "ablation")
    text = to_markdown(run)
    assert text.startswith("# Ablation study")
    assert "AUC" not in text
    # Of the second sequence 20 frames, the drop, and what comes ten frames after the restart.
    accuracy, robustness = (40 + 25) / (40 + 26), np.exp(-30 / 80)
    figures = [accuracy, robustness, (accuracy + robustness) / 2]
    table = summary_table(run, "made")
    assert table.header[:6] == ["tracker", "accuracy", "drops", "robustness", "average", "frames"]
    assert cells(table, 1)[1:6] == [
        f"{figures[0]:.3f}",
        "1",
        f"{figures[1]:.3f}",
        f"{figures[2]:.3f}",
        "80",
    ]
    assert marks(table, "drops") == ["best", "second"]  # less is better
    assert marks(table, "frames") == ["", ""]
    accuracies, drops = sequence_tables(run, "made")
    assert cells(accuracies, 1) == ["y", "40", "1.000", f"{25 / 26:.3f}"]
    assert cells(drops, 1) == ["y", "40", "0", "1"]


def test_vot_has_its_own_figures(restarts):
    run = run_of(restarts, "vot", stack="vot2014")
    table = summary_table(run, "made")
    assert table.header[:6] == ["tracker", "EAO", "A", "R", "S(30)", "failures"]
    reliability = np.exp(-0.5 / 40 * 30)
    assert cells(table, 1)[1:6] == ["-", "1.000", "0.500", f"{reliability:.3f}", "1"]
    assert marks(table, "R") == ["best", "second"]  # failures a sequence
    assert marks(table, "S(30)") == ["best", "second"]
    text = to_markdown(run)
    assert text.startswith("# VOT's supervised experiment, vot2014")
    assert "### A by sequence" in text and "### failures by sequence" in text
    # Each repetition is one more run of the same.
    again = [replace(result, repeat=1) for result in restarts]
    (_, row) = run_of([*restarts, *again], "vot", stack="vot2014").tracker_rows
    assert (row.sequences, row.figures.mean["failures"]) == (2, 1.0)


def test_all_boxes_together_are_not_the_mean(sequence_of):
    long, short = sequence_of([BOX] * 4, "long", "d"), sequence_of([BOX] * 2, "short", "d")
    run = run_of(
        [one_pass("t", long, [BOX, BOX, BOX, FAR]), one_pass("t", short, [BOX, FAR])],
        "imagenet-vid",
    )
    table = summary_table(run, "d")
    pooled, after_first = 4 / 6 * 20 / 21, 2 / 4 * 20 / 21
    assert cells(table, 0)[:5] == ["t", f"{pooled:.3f}", f"{after_first:.3f}", "2", "6"]
    (by_track,) = sequence_tables(run, "d")
    assert [cells(by_track, row)[2] for row in (0, 1)] == [
        f"{3 / 4 * 20 / 21:.3f}",
        f"{1 / 2 * 20 / 21:.3f}",
    ]


def test_best_and_second_are_those_printed(sequence_of):
    sequence = sequence_of([BOX] * 3, "a", "d")
    two = [BOX, BOX, FAR]
    run = run_of(
        [
            one_pass("slow", sequence, two, 0.5),
            one_pass("fast", sequence, two, 0.01),
            one_pass("poor", sequence, [BOX, FAR, FAR], 0.1),
        ]
    )
    table = summary_table(run, "d")
    assert marks(table, "tracker") == ["tracker"] * 3
    assert marks(table, "AO") == ["best", "best", "second"]
    assert marks(table, "FPS") == ["", "best", "second"]
    (speeds,) = speed_tables(run, "d")
    assert marks(speeds, "p50 ms") == ["", "best", "second"]
    assert marks(speeds, "reading ms") == ["", "", ""]
    # Trackers that ran side by side have no speeds.
    together = replace(run, jobs=2)
    assert "FPS" not in summary_table(together, "d").header
    assert speed_tables(together, "d") == []
    # A single tracker is not the best of anything.
    assert marks(summary_table(replace(run, results=run.results[:1]), "d"), "AUC") == [""]


@pytest.mark.parametrize(
    ("fps", "text"), [(2.04, "2.0"), (99.9, "99.9"), (150.4, "150"), (float("nan"), "-")]
)
def test_speed(fps, text):
    assert speed(fps) == text


def test_tables_fit_a_narrow_terminal(run):
    tables = console_tables(run)
    # Figures, times and sequences of the one dataset; the other has one sequence and no update.
    assert len(tables) == 4
    console = Console(width=80, force_terminal=False)
    with console.capture() as capture:
        for table in tables:
            console.print(table)
    text = capture.get()
    assert "one: 2 sequences, ope" in text and "two: 1 sequence, ope" in text
    assert "one: AUC by sequence" in text
    for figure in ("0.714", "0.476 x", "SR.75", "100"):
        assert figure in text
    assert "…" not in text


def test_brackets_in_a_name_are_printed(run):
    console = Console(width=160)
    named = [replace(result, tracker="[bold]a") for result in run.results[:1]]
    with console.capture() as capture:
        console.print(*console_tables(replace(run, results=named)))
    assert "[bold]a" in capture.get()


def test_names_are_no_markup_in_markdown_and_no_formulas_in_csv(sequence_of):
    name = "a|b <script> *x* [y](z) `c` _d_ e_f"
    sequence = sequence_of([BOX] * 2, name, "=cmd|'/c calc'!A1")
    run = replace(
        run_of([one_pass("@SUM(1)", sequence, [BOX, FAR], failure="frame 1: <b> raised")]),
        command="re3 eval `rm`",
    )
    text = to_markdown(run)
    shown = r"a\|b \<script> \*x\* \[y\](z) \`c\` \_d\_ e_f"
    assert f"| {shown} | 2 |" in text
    assert r"## =cmd\|'/c calc'!A1: 1 sequence, ope" in text
    assert r"frame 1: \<b> raised" in text
    assert "- command: `` re3 eval `rm` ``" in text
    (row,) = csv.DictReader(io.StringIO(results_csv(run)))
    assert (row["dataset"], row["tracker"]) == ("'=cmd|'/c calc'!A1", "'@SUM(1)")
    assert row["sequence"] == name
    # Numbers are numbers.
    assert float(row["p95_seconds"]) > 0


def test_repetitions_are_printed_with_their_spread(sequence_of):
    sequence = sequence_of([BOX] * 2, "a", "d")
    results = [
        one_pass("t", sequence, [BOX, BOX], repeat=0),
        one_pass("t", sequence, [BOX, FAR], repeat=1),
    ]
    assert cells(summary_table(run_of(results), "d"), 0)[4] == f"0.500 ± {np.sqrt(0.5):.3f}"
    # By sequence their mean.
    assert cells(sequence_tables(run_of(results), "d")[0], 0)[2] == f"{15 / 21:.3f}"


def test_notes_name_failures_reused_results_and_what_ran_side_by_side(run):
    said = notes(replace(run, jobs=3))
    assert len(said) == 4
    assert said[0].startswith("bad failed on b, frame 1")
    assert said[1].startswith("1 sequence has truth in the frame of the start alone")
    assert said[1].endswith("left out of the figures: c")
    assert said[2].startswith("1 of 1 results of good on two were taken")
    assert said[3].startswith("3 sequences ran at the same time")
