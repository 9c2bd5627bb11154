"""`re3 tsne` and the states behind it."""

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.evaluation.tsne import StatePath, embed, record, recorder, state_vector, tsne_plot

BOX = "30,20,40,32"


def run(*arguments):
    return CliRunner().invoke(app, ["tsne", *(str(argument) for argument in arguments)])


@pytest.fixture
def extra():
    for module in ("matplotlib", "sklearn"):
        pytest.importorskip(module, reason=f'needs {module}: pip install "re3[report]"')


@pytest.fixture
def clips(tmp_path):
    """Two annotated folders of 8 images each, `left` and `right`."""
    folder = tmp_path / "made"
    random = np.random.default_rng(0)
    texture = cv2.resize(random.integers(0, 255, (8, 10, 3)).astype(np.uint8), (40, 32))
    for name, step in (("left", -2), ("right", 3)):
        (folder / name).mkdir(parents=True)
        lines = []
        for index in range(8):
            image = np.full((120, 160, 3), 90, np.uint8)
            x = 30 + step * index
            image[20:52, x : x + 40] = texture
            cv2.imwrite(str(folder / name / f"{index}.png"), image)
            lines.append(f"{x},20,40,32\n")
        (folder / f"{name}.txt").write_text("".join(lines))
    return folder


class CountingTracker:
    """A tracker whose state says how often it was called."""

    def init(self, frame, box_xywh):
        self.calls = 0

    def update(self, frame):
        self.calls += 1

    def save_state(self):
        return {
            "3/state/lstm1_cell": np.array([self.calls, 1.0]),
            "3/state/lstm1_output": np.array([2.0]),
            "3/state/template": np.full((2, 2), 7.0),
            "3/first_state/lstm1_cell": np.full(2, 9.0),
        }


def test_a_state_is_the_cells_and_outputs_alone():
    path = record("clip", [np.zeros((4, 4, 3), np.uint8)] * 3, (0, 0, 2, 2), CountingTracker())
    np.testing.assert_array_equal(path.states, [[0, 1, 2], [1, 1, 2], [2, 1, 2]])
    assert path.occluded is None
    with pytest.raises(ValueError, match="no LSTM"):
        state_vector({"3/state/template": np.zeros(2)})
    with pytest.raises(ValueError, match="no frames"):
        record("clip", [], (0, 0, 2, 2), CountingTracker())


def test_marks_end_with_the_frames():
    frames = [np.zeros((4, 4, 3), np.uint8)] * 2
    marks = np.array([False, True, True])
    assert record("c", frames, (0, 0, 2, 2), CountingTracker(), marks).occluded.tolist() == [
        False,
        True,
    ]


def test_without_reset_the_state_goes_on_where_it_would_return():
    random = np.random.default_rng(1)
    frame = random.integers(0, 255, (60, 80, 3)).astype(np.uint8)
    frames = [frame] * 34
    kept, reset = (
        record("c", frames, (20, 20, 24, 24), recorder("re3-lite", reset=on, threads=1)).states
        for on in (False, True)
    )
    np.testing.assert_array_equal(kept[:32], reset[:32])
    # After 32 updates the model is back in its first state.
    np.testing.assert_array_equal(reset[32], reset[0])
    assert np.abs(kept[32] - kept[0]).max() > 1e-3
    assert kept.shape == (34, 4 * 256)


def test_a_path_breaks_off_where_the_state_returns(extra):
    random = np.random.default_rng(1)
    frames = [random.integers(0, 255, (60, 80, 3)).astype(np.uint8)] * 67
    box = (20, 20, 24, 24)
    with_returns = record("c", frames, box, recorder("re3-lite", threads=1))
    assert with_returns.breaks == (32, 64)
    assert record("c", frames, box, recorder("re3-lite", reset=False, threads=1)).breaks == ()
    positions = random.normal(0, 1, (67, 2))
    drawn = tsne_plot([with_returns], [positions]).axes[0].lines[0].get_xydata()
    assert np.flatnonzero(np.isnan(drawn[:, 0])).tolist() == [32, 65]
    np.testing.assert_array_equal(drawn[~np.isnan(drawn[:, 0])], positions)


def test_states_close_by_stay_close_by(extra):
    random = np.random.default_rng(0)
    paths = [
        StatePath(name, (10 * number + random.normal(0, 0.1, (20, 6))).astype(np.float32))
        for number, name in enumerate("ab")
    ]
    a, b = embed(paths)
    assert a.shape == b.shape == (20, 2)
    between = np.linalg.norm(a.mean(axis=0) - b.mean(axis=0))
    assert between > 2 * max(a.std(axis=0).max(), b.std(axis=0).max())
    np.testing.assert_array_equal(a, embed(paths)[0])
    with pytest.raises(ValueError, match="too few"):
        embed([StatePath("c", np.zeros((4, 3), np.float32))])
    with pytest.raises(ValueError, match="perplexity is 0"):
        embed(paths, perplexity=0)


def test_one_path_a_clip_and_circles_where_occluded(extra):
    marks = np.array([False, True, True])
    paths = [
        StatePath("one", np.zeros((3, 2), np.float32), marks),
        StatePath("two", np.zeros((2, 2), np.float32)),
        StatePath("two", np.zeros((2, 2), np.float32)),  # names may repeat
    ]
    positions = [np.array([[0, 0], [1, 1], [2, 1.0]]), np.ones((2, 2)), np.zeros((2, 2))]
    axes, beside = tsne_plot(paths, positions).axes
    assert len(axes.lines) == 3
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), positions[0])
    assert len({line.get_color() for line in axes.lines}) == 3
    hollow = [c for c in axes.collections if not len(c.get_facecolors()) and len(c.get_offsets())]
    assert len(hollow) == 1
    np.testing.assert_array_equal(hollow[0].get_offsets(), positions[0][1:])
    texts = [text.get_text() for text in beside.get_legend().get_texts()]
    assert texts == ["one", "two", "two", "first frame", "occluded frame"]


def test_a_folder_of_annotated_clips(extra, clips, tmp_path):
    out = tmp_path / "deep" / "tsne.svg"
    result = run(clips, "--out", out, "--threads", 1, "--max-frames", 6)
    assert result.exit_code == 0, result.output
    assert "left: 6 frames" in result.output and "right: 6 frames" in result.output
    text = out.read_text()
    assert ">left</text>" in text and ">right</text>" in text


def test_clips_with_boxes(extra, clips, tmp_path):
    out = tmp_path / "tsne.png"
    arguments = ("--box", BOX, "--box", BOX, "--threads", 1)
    result = run(clips / "left", clips / "right", *arguments, "--out", out)
    assert result.exit_code == 0, result.output
    assert "16 states" in result.output
    assert cv2.imread(str(out)).shape[0] > 300


def test_one_annotated_clip(extra, clips, tmp_path):
    result = run(clips / "left", "--threads", 1, "--out", tmp_path / "tsne.pdf")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "tsne.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["{clips}/left", "--out", "{clips}/t.jpg"], "does not end in .svg, .pdf or .png"),
        (["{clips}/left", "--box", "1,2", "--out", "{clips}/t.svg"], "'1,2' is not X,Y,W,H"),
        (["{clips}/left", "--box", "a,b,c,d", "--out", "{clips}/t.svg"], "is not X,Y,W,H"),
        (
            ["{clips}/left", "{clips}/right", "--box", BOX, "--out", "{clips}/t.svg"],
            "1 --box for 2 clips",
        ),
        (["{clips}/gone", "--out", "{clips}/t.svg"], "does not exist"),
        (["{clips}", "--model", "re4", "--out", "{clips}/t.svg"], "unknown model 're4'"),
        (["{clips}", "--max-frames", "2", "--out", "{clips}/t.svg"], "4 states are too few"),
    ],
)
def test_wrong_input_is_told(extra, clips, arguments, told):
    result = run(*(argument.format(clips=clips) for argument in arguments))
    assert result.exit_code == 2
    assert told in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert not list(clips.glob("t.*"))


def test_help_has_an_example():
    result = run("--help")
    assert result.exit_code == 0
    assert "re3 tsne clip.mp4 --box 120,80,60,140 --out tsne.svg" in result.output
