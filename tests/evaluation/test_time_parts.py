"""Where the time of a frame goes: measured, kept on disk, and shown."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from re3.apps.evaluate_tables import console_tables
from re3.data.plain import read_track
from re3.data.sequence import Sequence
from re3.evaluation.environment import Environment
from re3.evaluation.frame_log import FrameLog, Step
from re3.evaluation.html_report import to_html
from re3.evaluation.one_pass import Latency, Track, run_one_pass
from re3.evaluation.our_tracker import OurTracker
from re3.evaluation.protocols import find_protocol
from re3.evaluation.report_data import results_csv, results_json
from re3.evaluation.report_markdown import to_markdown
from re3.evaluation.report_tables import time_tables
from re3.evaluation.result_files import (
    load_supervised,
    load_track,
    save_supervised,
    save_track,
)
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.summary import Run
from re3.evaluation.supervised import SupervisedConfig, run_supervised
from re3.evaluation.time_parts import time_parts
from re3.timed_tracker import TimeSpent

BOX = (0.0, 0.0, 2.0, 2.0)
FAR = (50.0, 0.0, 2.0, 2.0)
COLUMNS = "score,seconds,decode_seconds,crop_seconds,network_seconds"


class Tells:
    """Says that a call took as many seconds as the frame's grey level, and tenths of them."""

    def __init__(self, boxes):
        self.boxes = boxes

    def init(self, frame, box_xywh):
        self._note(frame)

    def update(self, frame):
        self._note(frame)
        return self.boxes[int(frame[0, 0, 0])], 0.5

    def _note(self, frame):
        level = float(frame[0, 0, 0])
        self.time_spent = TimeSpent(level / 10, level)


class Silent(Tells):
    def _note(self, frame):
        pass


def track_of(update, crop=None, network=None, decode=None, start=9.0) -> Track:
    """A track of a start and some updates, all of the same times."""
    times = [None if t is None else np.array([start, *t], float) for t in (decode, crop, network)]
    seconds = np.array([start, *update], float)
    boxes = np.tile(BOX, (len(seconds), 1))
    return Track(boxes, np.ones(len(seconds)), seconds, None, times[0], False, *times[1:])


def run_of(tracks, jobs=1) -> Run:
    (frames,) = {len(track.seconds) for track in tracks.values()}
    clip = Sequence("clip", Path("clip.mp4"), np.tile(BOX, (frames, 1)), dataset="made")
    return Run(
        command="re3 eval data",
        data=("data",),
        environment=Environment("Test CPU", 2, 0.25, "Linux", "2024-05-06", {"re3": "1.2.3"}),
        protocol=find_protocol("ope"),
        jobs=jobs,
        results=[SequenceResult.of(name, clip, track) for name, track in tracks.items()],
    )


@pytest.fixture
def run() -> Run:
    return run_of(
        {
            "ours": track_of([0.010] * 4, [0.0005] * 4, [0.009] * 4, [0.002] * 4),
            "peer": track_of([0.020, 0.020, 0.020, 0.040], decode=[0.002] * 4),
        }
    )


def test_one_pass_asks_the_tracker_after_each_call(sequence_of):
    track = run_one_pass(lambda: Tells([BOX] * 4), sequence_of([BOX] * 4))
    np.testing.assert_allclose(track.crop_seconds, [0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(track.network_seconds, [0, 1, 2, 3])
    silent = run_one_pass(lambda: Silent([BOX] * 4), sequence_of([BOX] * 4))
    assert np.isnan([silent.crop_seconds, silent.network_seconds]).all()
    assert np.isfinite(silent.seconds).all()


def test_restarts_keep_the_times_of_failed_frames_and_leave_out_those_of_starts(sequence_of):
    boxes = [BOX, BOX, FAR, BOX, BOX, BOX]
    track = run_supervised(lambda: Tells(boxes), sequence_of([BOX] * 6), SupervisedConfig(2))
    assert track.steps.tolist() == [Step.STARTED, 0, Step.FAILED, Step.SKIPPED, Step.STARTED, 0]
    np.testing.assert_allclose(track.network_seconds, [0, 1, 2, np.nan, 4, 5])
    # Of frames 1, 2 and 5: starts are no updates.
    assert time_parts([track.as_track()]).network == Latency(
        *(float(value) for value in np.percentile([1, 2, 5], (50, 95, 99)))
    )


def test_ours_tells_and_its_parts_make_no_more_than_the_whole(clips):
    track = run_one_pass(lambda: OurTracker("re3-lite"), read_track(clips / "patch"))
    assert (track.crop_seconds > 0).all()
    assert (track.network_seconds > 0).all()
    assert (track.crop_seconds + track.network_seconds < track.seconds).all()


def test_parts_are_over_updates_alone():
    parts = time_parts(
        [
            track_of([2, 4], crop=[0.5, 1], network=[1, 2], decode=[1, 1]),
            track_of([6], crop=[1.5], network=[3], decode=[10]),
        ]
    )
    assert parts.split
    medians = {name: getattr(parts, name).p50 for name in ("crop", "network", "rest", "update")}
    assert medians == {"crop": 1, "network": 2, "rest": 1, "update": 4}
    assert (parts.decode.p50, parts.whole.p50) == (1, 5)  # of 3, 5, 16
    assert parts.update.p95 == pytest.approx(5.8)


@pytest.mark.parametrize(
    ("tracks", "known"),
    [
        ([], set()),
        ([track_of([])], set()),  # a start alone
        ([track_of([1.0])], {"update"}),
        ([track_of([1.0], decode=[2.0])], {"update", "decode", "whole"}),
        # Some of an earlier run, which did not measure the parts.
        (
            [track_of([1.0]), track_of([3.0], crop=[1.0], network=[1.5])],
            {"update", "crop", "network", "rest"},
        ),
    ],
)
def test_what_was_not_measured_is_nan(tracks, known):
    parts = time_parts(tracks)
    names = ("decode", "crop", "network", "rest", "update", "whole")
    assert {name for name in names if not np.isnan(getattr(parts, name).p50)} == known
    assert parts.split == ("crop" in known)


def test_a_journal_keeps_the_parts(tmp_path):
    path = tmp_path / "journal"
    with path.open("w") as journal:
        log = FrameLog(2, journal)
        log.add(0, Step.STARTED, BOX, 1.0, 0.5, 0.1, 0.01, 1 / 3)
        log.add(1, Step.FOLLOWED, BOX, 0.5, 0.25, 0.1)
    read = FrameLog.read(path, 2)
    assert read.done == 2
    np.testing.assert_array_equal(read.crop_seconds, [0.01, np.nan])
    np.testing.assert_array_equal(read.network_seconds, [1 / 3, np.nan])


def test_an_older_journal_is_read(tmp_path):
    path = tmp_path / "journal"
    path.write_text("0,1,1.0,2.0,3.0,4.0,1.0,0.5,0.125\n1,3,nan,nan,nan,nan,nan,nan,0.25\n1,0,7")
    read = FrameLog.read(path, 3)
    assert read.done == 2
    assert read.boxes_xywh[0].tolist() == [1, 2, 3, 4]
    assert (read.seconds[0], read.decode_seconds.tolist()[:2]) == (0.5, [0.125, 0.25])
    assert np.isnan([read.crop_seconds, read.network_seconds]).all()


def test_result_files_keep_the_parts(tmp_path, sequence_of):
    sequence, path = sequence_of([BOX] * 4), tmp_path / "clip.txt"
    track = run_one_pass(lambda: Tells([BOX] * 4), sequence)
    save_track(path, track)
    assert path.with_suffix(".csv").read_text().splitlines()[0] == COLUMNS
    again = load_track(path, sequence)
    for name in ("seconds", "decode_seconds", "crop_seconds", "network_seconds"):
        np.testing.assert_array_equal(getattr(again, name), getattr(track, name))
    restarted = run_supervised(lambda: Tells([BOX, FAR, BOX, BOX]), sequence, SupervisedConfig(1))
    save_supervised(path, restarted)
    again = load_supervised(path, sequence)
    np.testing.assert_array_equal(again.steps, restarted.steps)
    np.testing.assert_array_equal(again.network_seconds, restarted.network_seconds)


def test_files_of_a_tracker_that_does_not_tell_are_as_they_were(tmp_path, sequence_of):
    sequence, path = sequence_of([BOX] * 4), tmp_path / "clip.txt"
    save_track(path, run_one_pass(lambda: Silent([BOX] * 4), sequence))
    header = path.with_suffix(".csv").read_text().splitlines()[0]
    assert header == "score,seconds,decode_seconds"
    assert np.isnan(load_track(path, sequence).crop_seconds).all()


@pytest.mark.parametrize(
    "header",
    [
        f"{COLUMNS},more",  # of a later version
        "score,seconds,crop_seconds,decode_seconds",  # out of order
        "score,seconds,decode_seconds,decode_seconds",
    ],
)
def test_columns_that_are_not_known_are_told(tmp_path, sequence_of, header):
    sequence, path = sequence_of([BOX]), tmp_path / "clip.txt"
    path.write_text("0,0,2,2\n")
    row = ",".join("1" for _ in header.split(","))
    path.with_suffix(".csv").write_text(f"{header}\n{row}\n")
    with pytest.raises(ValueError, match=r"clip\.csv does not have the columns score, seconds"):
        load_track(path, sequence)


def test_data_files_have_medians_and_nothing_of_a_peer(run):
    ours, peer = json.loads(results_json(run))["summary"]
    assert ours["crop_seconds"] == pytest.approx(0.0005)
    assert ours["network_seconds"] == pytest.approx(0.009)
    assert ours["parts_seconds"]["rest"]["p95"] == pytest.approx(0.0005)
    assert ours["parts_seconds"]["whole"]["p50"] == pytest.approx(0.012)
    assert peer["crop_seconds"] is None and peer["network_seconds"] is None
    assert peer["parts_seconds"]["update"]["p50"] == pytest.approx(0.020)
    first, second = csv.DictReader(results_csv(run).splitlines())
    assert float(first["network_seconds"]) == pytest.approx(0.009)
    assert (second["crop_seconds"], second["network_seconds"]) == ("", "")


def test_the_table_has_median_and_95_percent(run):
    (table,) = time_tables(run, "made")
    assert table.header == ["tracker", "reading", "crops", "network", "rest", "update", "whole"]
    assert [[cell.text for cell in row] for row in table.rows] == [
        [
            "ours",
            "2.0 / 2.0",
            "0.50 / 0.50",
            "9.0 / 9.0",
            "0.50 / 0.50",
            "10.0 / 10.0",
            "12.0 / 12.0",
        ],
        ["peer", "2.0 / 2.0", "-", "-", "-", "20.0 / 37.0", "22.0 / 39.0"],
    ]


@pytest.mark.parametrize(
    ("tracks", "jobs", "header"),
    [
        ({"peer": track_of([1.0])}, 1, ["tracker", "update"]),
        (
            {"peer": track_of([1.0], decode=[1.0])},
            0,
            ["tracker", "reading", "update", "whole"],
        ),
        ({"ours": track_of([1.0], [0.1], [0.2], [1.0])}, 2, None),  # side by side
        ({"published": track_of([], decode=[])}, 1, None),
    ],
)
def test_only_what_was_measured_is_shown(tracks, jobs, header):
    tables = time_tables(run_of(tracks, jobs), "made")
    assert [table.header for table in tables] == ([] if header is None else [header])


def test_decimals_fit_the_time(run):
    slow = track_of([1.25] * 4, [0.00025] * 4, [0.0995] * 4)
    (table,) = time_tables(run_of({"slow": slow}), "made")
    assert [cell.text for cell in table.rows[0]][1:] == [
        "0.25 / 0.25",
        "99.5 / 99.5",
        "1150 / 1150",
        "1250 / 1250",
    ]


def test_a_tracker_without_times_has_no_row(run):
    still = track_of([np.nan] * 4, start=np.nan)
    results = [*run.results, SequenceResult.of("still", run.results[0].sequence, still)]
    (table,) = time_tables(replace(run, results=results), "made")
    assert [row[0].text for row in table.rows] == ["ours", "peer"]


def test_every_report_shows_the_table(run):
    title = "Where the time of a frame goes, ms: median / 95 %"
    row = "| ours | 2.0 / 2.0 | 0.50 / 0.50 | 9.0 / 9.0 | 0.50 / 0.50 | 10.0 / 10.0 | 12.0 / 12.0 |"
    text = to_markdown(run)
    assert f"### {title}" in text and row in text.splitlines()
    console = Console(width=80, force_terminal=False)
    with console.capture() as capture:
        console.print(*console_tables(run))
    shown = capture.get()
    assert f"made: {title}" in shown and "0.50 / 0.50" in shown and "…" not in shown
    beside = replace(run, jobs=2)
    assert title not in to_markdown(beside)
    assert len(console_tables(beside)) == len(console_tables(run)) - 1


def test_the_page_shows_the_table(run):
    pytest.importorskip("matplotlib", reason='needs matplotlib: pip install "re3[report]"')
    pytest.importorskip("jinja2", reason='needs Jinja: pip install "re3[report]"')
    from re3.evaluation.plots_style import styles

    page = to_html(run, {}, styles(run.trackers))
    assert "Where the time of a frame goes" in page and "0.50 / 0.50" in page
    assert "Where the time" not in to_html(replace(run, jobs=2), {}, styles(run.trackers))
