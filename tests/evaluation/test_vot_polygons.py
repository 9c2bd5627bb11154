"""Truth that is a polygon, as VOT 2014 to 2016 have it: read, followed, scored."""

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer import Typer
from typer.testing import CliRunner

from re3.apps.evaluate import evaluate
from re3.apps.vot import vot
from re3.data.formats import read_dataset
from re3.data.formats.vot import read_truth
from re3.data.sequence import Sequence
from re3.evaluation.peers import find_tracker
from re3.evaluation.runner import run
from re3.evaluation.supervised import VOT, Step, SupervisedConfig, SupervisedTrack, run_supervised
from re3.evaluation.vot import VotRuns, VotStack, score_vot
from re3.evaluation.vot_overlap import pixel_overlaps, polygon_overlap
from re3.evaluation.vot_results import read_analysis, read_runs
from re3.evaluation.vot_toolkit import HOW_TO_INSTALL
from re3.evaluation.vot_workspace import write_sequences

SIZE = (120, 90)
FRAMES = 20
DIAMOND = ((5, 0), (10, 5), (5, 10), (0, 5))
SQUARE = ((10, 10), (19, 10), (19, 19), (10, 19))
CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])

toolkit = pytest.mark.skipif(
    importlib.util.find_spec("vot") is None or importlib.util.find_spec("trax") is None,
    reason=f"needs the VOT toolkit: {HOW_TO_INSTALL}",
)

app = Typer()
app.command("eval")(evaluate)
app.command("vot")(vot)


def invoke(*arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def turned(centre, size, degrees):
    """Corners of a box turned about its centre, `[4, 2]`."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return CORNERS * size @ np.array([[cosine, sine], [-sine, cosine]]) + centre


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """A VOT folder: `bar`, long and thin, turns and flees; `still` has upright boxes."""
    folder = tmp_path_factory.mktemp("data") / "vot2016"
    random = np.random.default_rng(0)
    ground = cv2.resize(random.integers(0, 200, (9, 12, 3)).astype(np.uint8), SIZE)
    truths = {
        "bar": [
            turned((35 + (45 if t > 11 else 0), 45), (50, 6), 20 + 3 * t) for t in range(FRAMES)
        ],
        "still": [np.array([20, 30, 24.5, 18])] * FRAMES,
    }
    for name, truth in truths.items():
        (folder / name).mkdir(parents=True)
        for index in range(FRAMES):
            cv2.imwrite(str(folder / name / f"{index + 1:08d}.jpg"), ground + 3 * index)
        lines = [",".join(f"{value:.3f}" for value in region.ravel()) for region in truth]
        (folder / name / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    (folder / "list.txt").write_text("bar\nstill\n")
    return folder


@pytest.fixture
def sequences(data) -> list[Sequence]:
    return read_dataset(data)


@pytest.mark.parametrize(
    ("box", "polygon", "size", "overlap"),
    [
        # The last column and row belong to it: ten by ten pixels.
        ((10, 10, 10, 10), SQUARE, (50, 50), 1.0),
        ((10, 10, 9, 9), SQUARE, (50, 50), 0.81),
        ((10.4, 9.6, 10.4, 9.6), SQUARE, (50, 50), 1.0),  # the same when rounded
        # 1, 3, 5, 7, 9, 11, 9, ... pixels a row.
        ((0, 0, 11, 11), DIAMOND, (50, 50), 61 / 121),
        ((0, 0, 11, 11), DIAMOND, (6, 50), 36 / 66),  # columns 0 to 5 are left of it
        ((0, 0, 11, 11), DIAMOND, (50, 6), 36 / 66),
        ((0, 5, 11, 1), DIAMOND, (50, 50), 11 / 61),
        ((0, 0, 3, 2), DIAMOND, (50, 50), 0.0),  # in the corner of its outermost box
        ((-2, -2, 4, 4), DIAMOND, (50, 50), 0.0),
        ((20, 20, 5, 5), DIAMOND, (50, 50), 0.0),
        ((10, 10, 0, 20), DIAMOND, (50, 50), 0.0),  # without a pixel
        ((-30, 0, 9, 9), np.array(DIAMOND) - (30, 0), (50, 50), 0.0),  # outside the frame
        # An hourglass: its edges cross, rows of 11, 9, 7, 5, 3, 1, 3, ... pixels.
        ((0, 0, 11, 11), ((0, 0), (10, 0), (0, 10), (10, 10)), (50, 50), 71 / 121),
        # Two teeth: two runs in a row.
        ((0, 3, 9, 1), ((0, 0), (2, 6), (4, 0), (6, 6), (8, 0), (4, 9)), (50, 50), None),
        ((5, 5, 1, 4), ((5, 5), (5, 9), (5, 7)), (50, 50), 1.0),  # one column: the toolkit's quirk
    ],
)
def test_overlap_with_a_polygon(box, polygon, size, overlap):
    found = polygon_overlap(box, polygon, size)
    if overlap is None:
        assert 0 < found < 1
    else:
        assert found == pytest.approx(overlap, abs=1e-12)


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)), min_size=3, max_size=7),
    st.tuples(*[st.integers(0, 20)] * 4),
    st.integers(0, 6),
)
def test_where_a_polygon_begins_does_not_matter(points, box, shift):
    polygon = np.array(points, dtype=float)
    expected = polygon_overlap(box, polygon, (60, 60))
    assert 0 <= expected <= 1
    assert polygon_overlap(box, np.roll(polygon, shift, axis=0), (60, 60)) == expected
    # Nor where both lie, inside the frame.
    moved = np.add(box, (shift, 2, 0, 0))
    assert polygon_overlap(moved, np.add(polygon, (shift, 2)), (60, 60)) == expected


def test_boxes_and_polygons_mix():
    boxes = np.array([(10, 10, 10, 10)] * 3 + [(np.nan,) * 4], float)
    truth = np.array([(10, 10, 10, 5)] * 2 + [(np.nan,) * 4, (0, 0, 10, 10)], float)
    polygons = [None, np.array(SQUARE), None, np.array(DIAMOND)]
    assert pixel_overlaps(boxes, truth, (50, 50), polygons).tolist() == [0.5, 1.0, 0.0, 0.0]
    assert pixel_overlaps(boxes, truth, (50, 50)).tolist() == [0.5, 0.5, 0.0, 0.0]
    with pytest.raises(ValueError, match="1 polygons for 4 boxes; expected one a box"):
        pixel_overlaps(boxes, truth, (50, 50), polygons[:1])


@toolkit
def test_overlap_is_the_toolkits():
    code = (
        "import json, sys; from vot.region import Polygon, Rectangle, calculate_overlaps;"
        "boxes, polygons = json.load(sys.stdin);"
        "print(json.dumps(calculate_overlaps([Rectangle(*box) for box in boxes],"
        "[Polygon([tuple(p) for p in polygon]) for polygon in polygons], (80, 70))))"
    )
    random = np.random.default_rng(0)
    boxes, polygons = [], []
    for _ in range(400):
        box = np.array([*random.uniform(-20, 80, 2), *random.uniform(0, 50, 2)])
        centre = box[:2] + box[2:] / 2 + random.normal(0, 8, 2)
        whole = random.integers(-3, 8, (4, 2))
        boxes += [box, box, np.abs(np.round(2 * box)) / 2, random.integers(0, 6, 4)]
        polygons += [
            turned(centre, random.uniform(1, 50, 2), random.uniform(0, 360)),
            random.uniform(-20, 100, (random.integers(3, 8), 2)),  # edges may cross
            np.round(random.uniform(-20, 180, (4, 2))) / 2,  # halves
            whole if random.random() < 0.9 else whole * (0, 1),  # small, some without an area
        ]
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps([np.array(boxes).tolist(), [p.tolist() for p in polygons]]),
        capture_output=True,
        text=True,
        check=True,
    )
    expected = np.array(json.loads(done.stdout))
    assert 0 < np.count_nonzero(expected == 0) < 1200 and np.count_nonzero(expected > 0.5) > 20
    found = pixel_overlaps(boxes, np.ones((len(boxes), 4)), (80, 70), polygons)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_polygons_are_read_beside_the_outermost_box(sequences):
    bar, still = sequences
    assert len(bar.polygons) == FRAMES
    assert bar.polygons[0].shape == (4, 2)
    for box, polygon in zip(bar.boxes_xywh, bar.polygons, strict=True):
        low, high = polygon.min(axis=0), polygon.max(axis=0)
        np.testing.assert_array_equal(box, [*low, *(high - low)])
        with pytest.raises(ValueError, match="read-only"):
            polygon[0] = 0
    assert still.polygons is None


def test_a_truth_file_may_mix_regions(tmp_path):
    path = tmp_path / "groundtruth.txt"
    lines = ["1,2,3,4", "5,0,10,5,5,10,0,5", "0", "nan" + ",nan" * 7, "0,0,4,0,2,6", "1,1,5,1,9,1"]
    path.write_text("\n".join([*lines, "m3,4,5,2,1,2,3,1,3"]))
    boxes, polygons = read_truth(path)
    assert np.isnan(boxes[:, 0]).tolist() == [False, False, True, True, False, True, False]
    # A line without an area is no polygon either.
    assert [p if p is None else p.tolist() for p in polygons] == [
        None,
        [[5, 0], [10, 5], [5, 10], [0, 5]],
        None,
        None,
        [[0, 0], [4, 0], [2, 6]],
        None,
        None,
    ]


@pytest.mark.parametrize(
    ("polygons", "told"),
    [
        ((None,), "1 polygons for 2 boxes"),
        ((None, DIAMOND[:2]), r"row 1 has shape \(2, 2\)"),  # two corners
        ((((1, 2, 3),) * 3, None), r"row 0 has shape \(3, 3\)"),
        ((None, ((1, 2), (3, np.nan), (4, 5))), "row 1"),
    ],
)
def test_what_is_no_polygon_is_refused(polygons, told):
    boxes = np.array([(0, 0, 10, 10)] * 2, float)
    with pytest.raises(ValueError, match=f"'clip'.*{told}"):
        Sequence("clip", Path("clip.mp4"), boxes, polygons=polygons)
    with pytest.raises(ValueError, match=r"row 1.*in a frame with a box"):
        absent = np.array([(0, 0, 10, 10), (np.nan,) * 4])
        Sequence("clip", Path("clip.mp4"), absent, polygons=(DIAMOND, DIAMOND))
    assert Sequence("clip", Path("clip.mp4"), boxes, polygons=(None, None)).polygons is None


def test_one_pass_compares_with_the_outermost_box(sequences):
    bar = sequences[0]
    (result,) = run([find_tracker("first-box")], [bar])
    (plain,) = run([find_tracker("first-box")], [replace(bar, polygons=None)])
    assert result.scores == plain.scores


class Corner:
    """Stays in the corner of the outermost box that no part of the diamond is in."""

    def init(self, frame, box_xywh):
        self.box = (*box_xywh[:2], 4, 4)

    def update(self, frame):
        return self.box, 0.5


@pytest.mark.parametrize(
    ("config", "letters"),
    [
        (VOT, "SX----SX"),
        (SupervisedConfig(by_pixels=True, restart_after=1), "SXSXSXSX"),
        (SupervisedConfig(), "Sfffffff"),  # upright boxes
    ],
)
def test_a_failure_is_judged_by_the_polygon(data, config, letters):
    polygon = 2 * np.array(DIAMOND) + 20
    box = np.array([[20, 20, 20, 20]] * 8, float)
    clip = Sequence("clip", data / "still", box, polygons=(polygon,) * 8)
    track = run_supervised(Corner, clip, config)
    assert "".join("fSX-"[step] for step in track.steps) == letters


def test_accuracy_is_that_of_the_polygon():
    boxes = np.array([(0, 0, 11, 11)] * 4, float)
    steps = np.array([Step.STARTED, *[Step.FOLLOWED] * 3], np.int8)
    track = SupervisedTrack(boxes, steps, np.zeros(4))
    stack = VotStack("test", "test", (1, 3), burn_in=1)
    # The last two frames have an upright box.
    polygons = (np.array(DIAMOND), np.array(DIAMOND), None, None)
    scores = score_vot([VotRuns("clip", boxes, (50, 50), [track], polygons)], stack)
    share = 61 / 121
    assert scores.accuracy == pytest.approx((share + 2) / 3)
    np.testing.assert_allclose(scores.curve, [0, share, (share + 1) / 2, (share + 2) / 3])
    assert score_vot([VotRuns("clip", boxes, (50, 50), [track])], stack).accuracy == 1.0


def test_the_workspace_keeps_the_polygon(sequences, tmp_path):
    write_sequences(tmp_path, sequences)
    written = (tmp_path / "sequences" / "bar" / "groundtruth.txt").read_text().splitlines()
    assert len(written) == FRAMES and {line.count(",") for line in written} == {7}
    first = [float(value) for value in written[0].split(",")]
    assert first == sequences[0].polygons[0].ravel().tolist()
    assert (tmp_path / "sequences/still/groundtruth.txt").read_text().startswith("20,30,24.5,18\n")
    folder = tmp_path / "results" / "kcf" / "baseline" / "bar"
    folder.mkdir(parents=True)
    (folder / "bar_001.txt").write_text("1\n" + "30,30,20,20\n" * (FRAMES - 1))
    (runs,) = read_runs(tmp_path, "kcf", ["bar"], 1)
    np.testing.assert_array_equal(runs.truth_xywh, sequences[0].boxes_xywh)
    np.testing.assert_array_equal(runs.polygons, sequences[0].polygons)
    np.testing.assert_array_equal(runs.runs[0].boxes_xywh[0], sequences[0].boxes_xywh[0])
    # Upright truth of the same boxes gives other figures, and is another sequence.
    with pytest.raises(ValueError, match="other truth, than 'bar'"):
        write_sequences(tmp_path, [replace(sequences[0], polygons=None), sequences[1]])


def test_eval_judges_and_scores_by_the_polygon(data, tmp_path):
    arguments = ("--protocol", "vot", "--vot-stack", "vot2014", "--jobs", 0, "-t", "first-box")
    file = tmp_path / "figures.json"
    printed = invoke("eval", data, *arguments, "--json", file)
    assert "S(30)" in printed
    document = json.loads(file.read_text())
    assert "polygon, overlap is that with the polygon" in document["conventions"]
    bar, still = document["sequences"]
    # The bar takes less than a third of its box; the first box of the upright one stays right.
    assert 0.05 < bar["accuracy"] < 0.35 < still["accuracy"] == 1.0


@toolkit
@pytest.mark.slow
def test_toolkit_and_we_agree_on_a_workspace_with_polygons(data, sequences, tmp_path):
    workspace = tmp_path / "w"
    arguments = ("--repetitions", 1, "--interval", "2,12", "--workspace", workspace)
    printed = " ".join(invoke("vot", data, "-t", "first-box", *arguments).split())
    assert "the truth is polygons in 1 of 2 sequences, upright boxes in the others" in printed
    stack = VotStack("vot2016", "vot2016/rgb", (2, 12), repetitions=1)
    (official,) = read_analysis(workspace / "analysis" / "re3.json", ["first-box"], stack)
    runs = read_runs(workspace, "first-box", ["bar", "still"], 1)
    ours = score_vot(runs, stack)
    assert ours.accuracy == pytest.approx(official.accuracy, abs=1e-12)
    assert ours.robustness == pytest.approx(official.robustness, abs=1e-12)
    assert ours.failures == official.failures == 1
    assert ours.eao == pytest.approx(official.eao, abs=1e-6)
    # The tracker was handed the outermost box, and our own run of it is the same.
    for sequence, theirs in zip(sequences, runs, strict=True):
        alone = run_supervised(find_tracker("first-box").factory, sequence)
        np.testing.assert_array_equal(alone.steps, theirs.runs[0].steps)
        np.testing.assert_allclose(alone.boxes_xywh, theirs.runs[0].boxes_xywh, atol=0.002)
    assert score_vot([replace(run, polygons=None) for run in runs], stack).accuracy != (
        pytest.approx(ours.accuracy, abs=0.1)
    )
