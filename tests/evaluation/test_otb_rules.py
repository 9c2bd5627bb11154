"""Figures by the rules of OTB's toolkit, against a literal reading of them in pixels from 1."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from re3.apps.evaluate import evaluate
from re3.data.sequence import Sequence
from re3.evaluation.metrics import frame_errors, score
from re3.evaluation.protocols import find_protocol, with_otb_rules
from re3.evaluation.published import looks_shifted, published_track

NAN = (np.nan,) * 4
TRUTH = (9.0, 9.0, 20.0, 10.0)

app = typer.Typer()
app.command()(evaluate)


def toolkit(results, truth):
    """AUC and precision at 20 px, frame by frame, of boxes `[T, 4]` in pixels counted from 1."""
    results, truth = [list(row) for row in results], [list(row) for row in truth]
    overlaps, distances = [], []
    for t, (box, true) in enumerate(zip(results, truth, strict=True)):
        lacks = all(np.isnan(box)) or box[2] <= 0 or box[3] <= 0
        if t > 0 and lacks and not any(np.isnan(true)):
            results[t] = box = results[t - 1]
        if t == 0:
            box = true
        if not all(value > 0 for value in true):
            overlaps.append(-1.0)
            distances.append(-1.0)
            continue
        # Pixels of both, the last ones included.
        across = min(box[0] + box[2], true[0] + true[2]) - max(box[0], true[0])
        down = min(box[1] + box[3], true[1] + true[3]) - max(box[1], true[1])
        common = max(0.0, across) * max(0.0, down)
        overlaps.append(common / (box[2] * box[3] + true[2] * true[3] - common))
        centres = [(b[0] + (b[2] - 1) / 2, b[1] + (b[3] - 1) / 2) for b in (box, true)]
        distances.append(float(np.hypot(*np.subtract(*centres))))
    # The same box may overlap itself by a little more than 1.
    overlaps, distances = np.round(overlaps, 12), np.array(distances)
    thresholds = np.linspace(0, 1, 21)
    success = [np.count_nonzero(overlaps > each) / len(truth) for each in thresholds]
    return float(np.mean(success)), np.count_nonzero(distances <= 20) / len(truth)


def test_the_figures_are_the_toolkits():
    random = np.random.default_rng(0)
    for _ in range(60):
        frames = int(random.integers(2, 40))
        steps = random.normal(0, 4, (frames, 2))
        truth = np.concatenate([np.cumsum(steps, axis=0), random.uniform(5, 30, (frames, 2))], 1)
        truth[1:][random.random(frames - 1) < 0.1] = np.nan
        truth[0, :2] = 5, 5
        results = truth + random.normal(0, 4, (frames, 4))
        results[:, 2:] = np.abs(results[:, 2:])
        results[0] = truth[0]
        results[1:][random.random(frames - 1) < 0.15] = np.nan
        results[1:, 2:][random.random((frames - 1, 2)) < 0.05] = 0
        first_pixel = np.array([1.0, 1.0, 0.0, 0.0])
        ours = score(results, truth, otb_rules=True)
        expected = toolkit(results + first_pixel, truth + first_pixel)
        assert (ours.auc, ours.precision) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("predicted", "truth", "default", "rules"),
    [
        # Overlap 1 and distance 0 throughout: 20 of 21 thresholds.
        ([TRUTH] * 4, [TRUTH] * 4, (20 / 21, 1.0), (20 / 21, 1.0)),
        # No box: a miss; the toolkit takes the last one.
        ([TRUTH, TRUTH, NAN, NAN], [TRUTH] * 4, (10 / 21, 0.5), (20 / 21, 1.0)),
        ([TRUTH, TRUTH, (0, 0, 0, 0), TRUTH], [TRUTH] * 4, (15 / 21, None), (20 / 21, 1.0)),
        # In the toolkit's pixels the true box begins at 0: a miss in success, a hit in precision.
        ([TRUTH] * 2, [TRUTH, (-1.0, 9, 20, 10)], (None, 1.0), (10 / 21, 1.0)),
        ([TRUTH] * 2, [TRUTH, (300.0, -40, 20, 10)], (10 / 21, 0.5), (10 / 21, 1.0)),
        # At 1 it is compared.
        ([TRUTH, (0, 9, 20, 10)], [TRUTH, (0.0, 9, 20, 10)], (20 / 21, 1.0), (20 / 21, 1.0)),
        # Without truth it is left out; in the toolkit it counts as above.
        ([TRUTH] * 2, [TRUTH, NAN], (20 / 21, 1.0), (10 / 21, 1.0)),
    ],
)
def test_what_differs_from_the_default(predicted, truth, default, rules):
    for otb_rules, (auc, precision) in ((False, default), (True, rules)):
        figures = score(predicted, truth, otb_rules=otb_rules)
        assert auc is None or figures.auc == pytest.approx(auc)
        assert precision is None or figures.precision == pytest.approx(precision)


def test_frames_before_the_start_do_not_count():
    truth = [NAN, NAN, TRUTH, TRUTH]
    assert frame_errors(truth, truth, otb_rules=True).frames.tolist() == [2, 3]
    assert score(truth, truth, otb_rules=True).auc == pytest.approx(20 / 21)


def test_real_truths_of_otb(shared_data):
    """The truth itself has an overlap of 1 by the default; the toolkit leaves boxes out."""
    from re3.data.formats import read_dataset

    for sequence in read_dataset(shared_data / "test" / "otb"):
        truth = sequence.boxes_xywh
        left_out = np.mean(~((truth[:, :2] > -1).all(axis=1) & sequence.annotated))
        figures = score(truth, truth, otb_rules=True)
        assert figures.auc == pytest.approx(20 / 21 * (1 - left_out))
        assert (figures.precision, score(truth, truth).auc) == (1.0, pytest.approx(20 / 21))


def test_only_otbs_experiments_have_its_rules():
    assert "last one is repeated" in with_otb_rules(find_protocol("sre")).conventions
    with pytest.raises(ValueError, match="of OTB's experiments, ope, tre, sre, not of vot"):
        with_otb_rules(find_protocol("vot"))


# Published boxes


@pytest.fixture
def published(clips, tmp_path):
    """The truth of `clips` as a tracker's result, counted from 1, without a box in two frames."""
    folder = tmp_path / "Oracle"
    folder.mkdir()
    for truth in clips.glob("*.txt"):
        rows = [[float(value) for value in line.split(",")] for line in truth.open()]
        lines = [f"{x + 1},{y + 1},{w},{h}" for x, y, w, h in rows]
        lines[5:7] = ["nan,nan,nan,nan"] * 2
        (folder / truth.name).write_text("\n".join(lines) + "\n")
    return folder


def figures(clips, published, tmp_path, *options):
    file = tmp_path / "figures.json"
    arguments = [clips, "-t", f"published:{published}", "--json", file, *options]
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return json.loads(file.read_text())


def test_published_boxes_may_count_from_1(clips, published, tmp_path):
    told = figures(clips, published, tmp_path)
    auc = told["summary"][0]["figures"]["auc"]
    assert auc < 0.75
    (note,) = (note for note in told["notes"] if "one pixel beside" in note)
    assert note.endswith("if they count pixels from 1, give --published-from 1")
    right = figures(clips, published, tmp_path, "--published-from", 1)
    assert right["notes"] == []
    # Of 12 and of 10 annotated frames, two without a box.
    assert right["summary"][0]["figures"]["auc"] == pytest.approx(20 / 21 * (10 / 12 + 8 / 10) / 2)
    rules = figures(clips, published, tmp_path, "--published-from", 1, "--otb-rules")
    assert rules["summary"][0]["figures"]["auc"] > right["summary"][0]["figures"]["auc"]
    assert "OTB's toolkit" in rules["conventions"]


@pytest.mark.parametrize(
    ("offset", "first_pixel", "shifted"),
    [
        ((1, 1, 0, 0), 0, True),
        ((0, 0, 0, 0), 0, False),
        ((0, 0, 0, 0), 1, True),
        ((1, 1, 0, 0), 1, False),
        ((1, 0, 0, 0), 0, False),
        ((1, 1, 2, 0), 0, False),
    ],
)
def test_boxes_that_begin_a_pixel_beside_the_truth_are_noticed(
    tmp_path, sequence_of, offset, first_pixel, shifted
):
    sequence: Sequence = sequence_of([NAN, TRUTH, TRUTH])
    row = ",".join(str(value) for value in np.add(TRUTH, offset))
    (tmp_path / "clip.txt").write_text(f"nan,nan,nan,nan\n{row}\n{row}\n")
    assert looks_shifted(tmp_path, [sequence], first_pixel) == shifted
    track = published_track(tmp_path, sequence, first_pixel)
    expected = np.add(TRUTH, offset) - (first_pixel, first_pixel, 0, 0)
    np.testing.assert_allclose(track.boxes_xywh, [NAN, TRUTH, expected])
    assert not looks_shifted(tmp_path / "none", [sequence])
