"""What is made of the results: Imagenet Video, the ablation study, occlusion, VOT."""

import math
from pathlib import Path

import numpy as np
import pytest

from re3.data.hiding import AFTER, HiddenSequence
from re3.data.sequence import Sequence
from re3.evaluation.ablation import ablation, robustness
from re3.evaluation.imagenet_vid import pooled_success
from re3.evaluation.metrics import score
from re3.evaluation.occlusion import attribute_means, occlusion_table
from re3.evaluation.one_pass import Track
from re3.evaluation.protocol import over_repeats
from re3.evaluation.protocols import PROTOCOLS, find_protocol
from re3.evaluation.reappearance import reappearance
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.supervised import Step, SupervisedTrack

NAN = (np.nan,) * 4
BOX = (0.0, 0.0, 10.0, 10.0)
HALF = (0.0, 0.0, 10.0, 5.0)  # overlaps BOX by .5
FAR = (500.0, 0.0, 10.0, 10.0)
STEPS = {"f": Step.FOLLOWED, "S": Step.STARTED, "X": Step.FAILED, "-": Step.SKIPPED}

# Re3, Table I, Imagenet Video, which has 273,505 boxes (sec. IV-B): drops, robustness.
TABLE_1 = {
    "A": (471, 0.95),
    "B": (367, 0.96),
    "C": (738, 0.92),
    "D": (450, 0.95),
    "E": (359, 0.96),
    "F": (320, 0.97),
    "G": (257, 0.97),
    "H": (233, 0.97),
    "J": (539, 0.94),
    "K": (274, 0.97),
}


def passed(boxes, name="clip", truth=None, repeat=0, unscored=False, **marks) -> SequenceResult:
    """A one-pass result."""
    count = len(boxes)
    sequence = Sequence(name, Path(name), np.array(truth or [BOX] * count), dataset="d", **marks)
    failure = "frame 0: cannot be read" if unscored else None
    track = Track(
        np.array(boxes, float), np.ones(count), np.full(count, 0.01), failure, unscored=unscored
    )
    return SequenceResult.of("t", sequence, track, repeat=repeat)


def restarted(steps: str, boxes=None, truth=None, failure=None, unscored=False) -> SequenceResult:
    """A result with restarts: a letter a frame, and what it said where it followed."""
    count = len(steps)
    sequence = Sequence("clip", Path("clip"), np.array(truth or [BOX] * count), dataset="d")
    said = np.array(boxes or [BOX] * count, float)
    said[[letter not in "fS" for letter in steps]] = np.nan
    track = SupervisedTrack(
        said,
        np.array([STEPS[letter] for letter in steps], np.int8),
        np.full(count, 0.01),
        failure,
        unscored=unscored,
    )
    return SequenceResult.of("t", sequence, track)


@pytest.mark.parametrize("row", TABLE_1)
def test_robustness_is_the_papers(row):
    drops, expected = TABLE_1[row]
    assert round(robustness(drops, 273_505), 2) == expected


@pytest.mark.parametrize(
    ("steps", "boxes", "accuracy", "drops"),
    [
        ("Sfff", [BOX, BOX, HALF, HALF], (1 + 1 + 0.5 + 0.5) / 4, 0),  # the first frame counts
        ("SfX-----", None, (1 + 1 + 0) / 3, 1),  # the drop counts, frames passed over do not
        ("SX-----S" + "f" * 9 + "f", [HALF] * 18, (0.5 + 0 + 0.5) / 3, 1),  # ten frames of grace
        ("SX-----Sf", [BOX] * 9, (1 + 0) / 2, 1),
    ],
)
def test_ablation(steps, boxes, accuracy, drops):
    figures = ablation([restarted(steps, boxes)])
    assert figures.accuracy == pytest.approx(accuracy)
    assert (figures.drops, figures.frames) == (drops, len(steps))
    assert figures.robustness == pytest.approx(math.exp(-30 * drops / len(steps)))
    assert figures.average == pytest.approx((figures.accuracy + figures.robustness) / 2)


def test_ablation_throws_all_frames_together():
    results = [restarted("S"), restarted("SXX", unscored=True), restarted("SX-")]
    figures = ablation(results)
    assert (figures.accuracy, figures.drops, figures.frames) == (pytest.approx(2 / 3), 1, 4)


def test_ablation_leaves_out_frames_without_truth():
    figures = ablation([restarted("-SfX", truth=[NAN, BOX, NAN, BOX])])
    assert (figures.accuracy, figures.frames) == (pytest.approx(0.5), 2)


def test_ablation_counts_what_follows_a_crash_as_missed():
    figures = ablation([restarted("SfX---", failure="frame 2: update raised")])
    assert (figures.accuracy, figures.drops) == (pytest.approx(2 / 6), 1)


def test_ablation_refuses_one_pass():
    with pytest.raises(ValueError, match="of one pass"):
        ablation([passed([BOX, BOX])])


def test_one_curve_over_all_boxes():
    long, short = passed([BOX, BOX, BOX, FAR], "long"), passed([FAR, FAR], "short")
    success = pooled_success([long, short, passed([BOX] * 9, "broken", unscored=True)])
    # The first frames are the truth: four of six boxes are right, two of four without them.
    np.testing.assert_allclose(success.curve, [4 / 6] * 20 + [0.0])
    assert success.auc == pytest.approx(4 / 6 * 20 / 21)
    assert success.auc_after_first == pytest.approx(2 / 4 * 20 / 21)
    assert (success.tracks, success.boxes) == (2, 6)
    # Not the mean over tracks, (3/4 + 1/2) / 2.
    assert success.auc != pytest.approx((3 / 4 + 1 / 2) / 2 * 20 / 21)


def test_one_curve_of_nothing_is_undefined():
    success = pooled_success([])
    assert np.isnan([success.auc, success.auc_after_first]).all()


def test_occluded_frames_beside_all():
    marks = np.array([False, False, True, True])
    marked = passed([BOX, BOX, BOX, FAR], occluded=marks)
    (row,) = occlusion_table([marked, passed([FAR, FAR], "unmarked")])
    assert (row.dataset, row.tracker) == ("d", "t")
    assert (row.everywhere.frames, row.occluded.frames) == (4, 2)
    assert (row.everywhere.precision, row.occluded.precision) == (0.75, 0.5)
    assert (row.everywhere.overlap, row.occluded.overlap) == (0.75, 0.5)
    assert row.everywhere.auc == pytest.approx(0.75 * 20 / 21)
    assert row.relative_loss == pytest.approx(1 / 3)


def test_occluded_frames_without_truth_are_left_out():
    marks = np.array([False, True, True])
    (row,) = occlusion_table([passed([BOX] * 3, truth=[BOX, NAN, BOX], occluded=marks)])
    assert (row.everywhere.frames, row.occluded.frames) == (2, 1)


def test_never_occluded_is_no_loss_at_all():
    (row,) = occlusion_table([passed([BOX, BOX], occluded=np.zeros(2, bool))])
    assert row.occluded.frames == 0
    assert np.isnan([row.relative_loss, row.occluded.auc]).all()
    assert occlusion_table([passed([BOX, BOX])]) == []


def test_means_by_attribute():
    fast = passed([BOX, FAR], "a", attributes=("fast", "dark"))
    dark = passed([BOX, BOX], "b", attributes=("dark",))
    rows = attribute_means([fast, dark, passed([BOX, BOX], "c")])
    assert [(r.attribute, r.tracker, r.sequences, r.scores.ao) for r in rows] == [
        ("dark", "t", 2, 0.5),
        ("fast", "t", 1, 0.0),
    ]


def test_figures_over_repetitions():
    results = [passed([BOX, BOX], repeat=0), passed([BOX, FAR], repeat=1)]
    figures = over_repeats(find_protocol("ope"), results)
    assert figures.mean["ao"] == 0.5
    assert figures.spread["ao"] == pytest.approx(math.sqrt(0.5))
    assert over_repeats(find_protocol("ope"), results[:1]).spread == {}
    expected = (score([BOX, BOX], [BOX, BOX]).auc + score([BOX, FAR], [BOX, BOX]).auc) / 2
    assert figures.mean["auc"] == pytest.approx(expected)


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_protocol_has_figures_of_nothing(name):
    protocol = find_protocol(name)
    assert protocol.name == name
    assert protocol.one_pass == (name not in ("ablation", "vot"))
    figures = protocol.summarise([])
    assert list(figures) == [measure.name for measure in protocol.measures]
    shown = [*protocol.by_sequence, *(axis.measure for axis in protocol.trade_off or ())]
    assert all(protocol.measure(name).best is not None for name in shown)
    assert (protocol.trade_off is None) == protocol.one_pass
    assert all(np.isnan(value) or value == 0 for value in figures.values())


def test_unknown_names_are_told():
    with pytest.raises(ValueError, match="no protocol 'otb'; expected one of ope, "):
        find_protocol("otb")
    with pytest.raises(ValueError, match=r"no VOT challenge 'vot1999'.*vot2016"):
        find_protocol("vot", "vot1999")


@pytest.mark.parametrize(
    ("before", "at_return", "later", "expected"),
    [
        (BOX, BOX, BOX, (1, 1, 1)),
        (BOX, FAR, BOX, (1, 1, 1)),  # taken back within the frames it has for that
        (BOX, FAR, FAR, (0, 1, 0)),
        (FAR, FAR, FAR, (0, 0, 0)),  # never had it
        (BOX, BOX, HALF, (1, 1, 0.5)),
        (BOX, BOX, NAN, (0, 1, 0)),  # stopped
    ],
)
def test_who_is_alive_after_the_object_is_back(before, at_return, later, expected):
    hidden = HiddenSequence.of(Sequence("s", Path("s"), np.array([BOX] * 20)), 3, 6)
    said = [before] * 3 + [FAR] * 3 + [at_return] * AFTER + [later] * 4
    track = Track(np.array(said, float), np.ones(20), np.full(20, 0.01))
    found = reappearance([SequenceResult.of("t", hidden, track)])
    assert (found.alive, found.alive_before, found.overlap_after) == pytest.approx(expected)


def test_sequences_that_hide_nothing_say_nothing_of_who_is_alive():
    assert math.isnan(reappearance([passed([BOX] * 3)]).alive)


def test_the_hidden_protocol_runs_on_sequences_of_its_own():
    protocol = find_protocol("hidden")
    assert protocol.prepare is not None
    made = protocol.prepare([Sequence("s", Path("s"), np.array([BOX] * 40), dataset="d")])
    assert [s.dataset for s in made] == ["d-hidden-5", "d-hidden-10"]


def test_the_framed_protocol_runs_from_parts_of_the_object_and_from_more():
    protocol = find_protocol("framed")
    assert protocol.prepare is not None
    boxes = np.array([[10.0, 20.0, 40.0, 20.0], [np.nan] * 4])
    made = protocol.prepare([Sequence("s", Path("s"), boxes, dataset="d")])
    first = {s.dataset: s.boxes_xywh[0].tolist() for s in made}
    assert first == {
        "d-framed-inner": pytest.approx([16, 23, 28, 14]),
        "d-framed-outer": pytest.approx([4, 17, 52, 26]),
        "d-framed-upper": pytest.approx([10, 20, 40, 10]),
        "d-framed-left": pytest.approx([10, 20, 24, 20]),
        "d-framed-wide": pytest.approx([2, 22, 56, 16]),
        "d-framed-tall": pytest.approx([16, 18, 28, 24]),
    }
    assert all(np.isnan(s.boxes_xywh[1]).all() for s in made)


def test_a_figure_over_starts_is_the_mean_over_clips_with_its_standard_error():
    results = [
        passed([BOX, BOX, BOX], "d/a/from-0"),
        passed([BOX, FAR, BOX], "d/a/from-1"),
        passed([BOX, FAR, FAR], "d/b/from-0"),
        passed([BOX, BOX, BOX], "d/c/from-0", unscored=True),
    ]
    figures = find_protocol("starts").summarise(results)
    a, b = (1 + 2 / 3) / 2 * 20 / 21, 1 / 3 * 20 / 21
    assert figures["auc"] == pytest.approx((a + b) / 2)
    # Of two values the standard error is half their distance.
    assert figures["auc_error"] == pytest.approx((a - b) / 2)
    assert figures["lost"] == pytest.approx((0.25 + 1) / 2)
    assert figures["ends_lost"] == pytest.approx((0 + 1) / 2)
    assert figures["clips"] == 2


def test_both_datasets_make_one_figure():
    protocol = find_protocol("starts")
    assert protocol.prepare is not None
    clips = [
        Sequence("s", Path("s"), np.array([BOX] * 30), dataset=dataset) for dataset in ("d", "e")
    ]
    made = protocol.prepare(clips)
    assert {s.dataset for s in made} == {"d+e-starts"}
    assert {protocol.row_of(s) for s in made} == {"d/s", "e/s"}
