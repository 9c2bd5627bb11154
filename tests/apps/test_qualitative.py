"""`re3 qualitative` and the frames it shows."""

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.data.plain import read_track
from re3.evaluation.plots_style import save
from re3.evaluation.qualitative import (
    PICTURE_WIDTH,
    Example,
    Shot,
    make_example,
    qualitative_plot,
)

NAN = (float("nan"),) * 4


def run(*arguments):
    return CliRunner().invoke(app, ["qualitative", *(str(argument) for argument in arguments)])


@pytest.fixture
def extra():
    pytest.importorskip("matplotlib", reason='needs matplotlib: pip install "re3[report]"')


@pytest.fixture
def clips(tmp_path):
    """`steady`, 6 frames, each a grey level lighter, and `late`, annotated from frame 2 on."""
    folder = tmp_path / "made"
    for name, absent in (("steady", 0), ("late", 2)):
        (folder / name).mkdir(parents=True)
        for index in range(6):
            cv2.imwrite(str(folder / name / f"{index}.png"), np.full((60, 80, 3), index, np.uint8))
        lines = [f"{10 + 4 * index},10,20,20" for index in range(6)]
        lines[:absent] = ["nan,nan,nan,nan"] * absent
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


class Fixed:
    """A tracker that gives the same box whatever it sees."""

    started = 0

    def init(self, frame, box_xywh):
        Fixed.started = int(frame[0, 0, 0])

    def update(self, frame):
        return (10, 10, 20, 20), 1.0


@pytest.mark.parametrize(
    ("name", "frame", "numbers", "levels"),
    [
        ("steady", 4, [1, 4], [0, 3]),
        ("steady", 100, [1, 6], [0, 5]),  # shorter than that: the last
        ("late", 2, [1, 2], [2, 3]),  # counted from the start of the track
        ("late", 4, [1, 4], [2, 5]),
    ],
)
def test_the_first_and_another_frame(clips, name, frame, numbers, levels):
    example = make_example(read_track(clips / name), Fixed, frame)
    assert example.name == name
    assert [shot.number for shot in example.shots] == numbers
    assert [int(shot.image[0, 0, 0]) for shot in example.shots] == levels
    assert Fixed.started == levels[0]
    assert example.shots[0].overlap == 1.0
    with pytest.raises(ValueError, match="frame is 1; expected 2"):
        make_example(read_track(clips / name), Fixed, 1)


def test_overlap_of_a_shot(clips):
    shot = make_example(read_track(clips / "steady"), Fixed, 3).shots[1]
    assert shot.overlap == pytest.approx(12 / 28)  # 8 pixels aside of 20
    image = np.zeros((4, 4, 3), np.uint8)
    assert Shot(2, image, np.array([0, 0, 2, 2.0]), np.array(NAN)).overlap == 0
    assert np.isnan(Shot(2, image, np.array(NAN), np.array([0, 0, 2, 2.0])).overlap)


def test_large_frames_are_made_smaller_with_their_boxes(tmp_path):
    (tmp_path / "big").mkdir()
    for index in range(2):
        cv2.imwrite(str(tmp_path / "big" / f"{index}.png"), np.zeros((540, 960, 3), np.uint8))
    (tmp_path / "big.txt").write_text("100,200,40,60\n" * 2)
    shot = make_example(read_track(tmp_path / "big"), Fixed, 2).shots[0]
    assert shot.image.shape == (270, PICTURE_WIDTH, 3)
    np.testing.assert_allclose(shot.truth_xywh, [50, 100, 20, 30])


def test_the_grid_has_both_boxes_and_the_overlap(extra):
    image = np.zeros((60, 80, 3), np.uint8)
    truth, box = np.array([10, 10, 20, 20.0]), np.array([18, 10, 20, 20.0])
    examples = [
        Example("a$1$", (Shot(1, image, truth, truth), Shot(100, image, truth, box))),
        Example("b", (Shot(1, image, truth, truth), Shot(7, image, np.array(NAN), box))),
    ]
    figure = qualitative_plot(examples, columns=1, tracker="ours")
    assert len(figure.axes) == 4
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == [r"a\$1\$", "frame 100: overlap 0.43", "b", "frame 7: no truth"]
    boxes = [[patch.get_bbox().bounds for patch in axes.patches] for axes in figure.axes]
    assert boxes == [[tuple(truth)], [tuple(truth), tuple(box)], [tuple(truth)], [tuple(box)]]
    green, red = (patch.get_edgecolor() for patch in figure.axes[1].patches)
    assert green[1] > 0.7 > green[0] and red[0] > 0.9 > red[1]
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["truth", "ours"]
    with pytest.raises(ValueError, match="0 examples in 3 columns"):
        qualitative_plot([])


@pytest.mark.parametrize("side", [4, 8, 20, 200])
def test_lines_leave_small_objects_in_sight(extra, side):
    image = np.zeros((270, PICTURE_WIDTH, 3), np.uint8)
    box = np.array([100.0, 50, side, side])
    shots = (Shot(1, image, box, box), Shot(9, image, box, box))
    figure = qualitative_plot([Example("a", shots)], columns=1)
    axes = figure.axes[1]
    # Points of a pixel of the picture, which fills its axes.
    point = axes.get_window_extent().width * 72 / figure.dpi / PICTURE_WIDTH
    for patch in axes.patches:
        # Half of a line lies inside the box, on either side.
        assert patch.get_linewidth() <= 0.3 * side * point
        assert patch.get_linewidth() >= 0.2


def test_the_truth_shows_where_both_boxes_are_the_same(extra, tmp_path):
    image = np.full((270, PICTURE_WIDTH, 3), 128, np.uint8)
    box = np.array([100.0, 50, 150, 120])
    shots = (Shot(1, image, box, box), Shot(9, image, box, box))
    save(qualitative_plot([Example("a", shots)], columns=1), tmp_path / "a.png")
    picture = cv2.imread(str(tmp_path / "a.png"))
    second = picture[picture.shape[0] // 5 :, picture.shape[1] // 2 :].astype(int)
    _, green, red = np.moveaxis(second, 2, 0)
    shown = int(((green > 150) & (red < 90)).sum()), int(((red > 180) & (green < 90)).sum())
    assert min(shown) > 0.3 * max(shown) > 20


def test_the_command_writes_the_grid(extra, clips, tmp_path):
    out = tmp_path / "fig7.svg"
    result = run(clips, "-t", "first-box", "--frame", 3, "--out", out)
    assert result.exit_code == 0, result.output
    assert "2 sequences" in result.output
    text = out.read_text()
    assert ">first-box</text>" in text and ">steady</text>" in text and ">late</text>" in text
    assert text.count(">frame 3: overlap 0.43</text>") == 2


def test_only_the_sequences_named_in_their_order(extra, clips, tmp_path):
    out = tmp_path / "fig7.svg"
    result = run(clips, "-t", "first-box", "-s", "steady,late", "--columns", 1, "--out", out)
    assert result.exit_code == 0, result.output
    text = out.read_text()
    assert 0 < text.index(">steady</text>") < text.index(">late</text>")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["{clips}", "--out", "{clips}/f.gif"], "does not end in .svg, .pdf or .png"),
        (["{clips}", "-t", "kfc", "--out", "{clips}/f.png"], "no tracker is called 'kfc'"),
        (["{clips}/gone", "-t", "first-box", "--out", "{clips}/f.png"], "gone does not exist"),
        (
            ["{clips}", "-t", "first-box", "-s", "a", "--out", "{clips}/f.png"],
            "no sequence is called a; there are",
        ),
        (["{clips}", "-t", "first-box", "-s", ",", "--out", "{clips}/f.png"], "names none"),
    ],
)
def test_wrong_input_is_told(extra, clips, arguments, told):
    result = run(*(argument.format(clips=clips) for argument in arguments))
    assert result.exit_code == 2
    assert told in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert not list(clips.glob("f.*"))


def test_help_has_an_example():
    result = run("--help")
    assert result.exit_code == 0
    assert "re3 qualitative data/davis -t re3-lite --out fig7.png" in result.output
