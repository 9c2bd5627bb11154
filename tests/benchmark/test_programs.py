"""The programs in benchmarks/: what they compute, and that each explains itself."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


def program(name):
    """One of the programs as a module."""
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_each_explains_itself(path):
    if path.stem == "limits":
        pytest.importorskip("onnx", reason="reads networks")
    done = subprocess.run(
        [sys.executable, path, "--help"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("usage:")


@pytest.fixture(scope="module")
def limits():
    pytest.importorskip("onnx", reason="reads networks")
    return program("limits")


@pytest.mark.parametrize(
    ("kind", "inputs", "output", "operations"),
    [
        ("MatMul", [[1, 100], [100, 7]], [1, 7], 1400),
        ("FusedGemm", [[2, 100], [7]], [2, 7], 2800),  # its weights are packed away
        ("Conv", [[1, 8, 10, 10], [4, 8, 3, 3]], [1, 4, 10, 10], 2 * 400 * 72),
        ("Conv", [[1, 8, 10, 10], [8, 1, 3, 3]], [1, 8, 10, 10], 2 * 800 * 9),  # by channel
        ("Relu", [[1, 4, 10, 10]], [1, 4, 10, 10], 400),
    ],
)
def test_operations(limits, kind, inputs, output, operations):
    arguments = {
        "op_name": kind,
        "input_type_shape": [{"float": shape} for shape in inputs],
        "output_type_shape": [{"float": output}],
    }
    assert limits.operations_of(arguments) == operations


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("/network/trunk/conv.1/Conv", "trunk"),
        ("network.head.fully_connected.0.weight_half", "fully connected"),
        ("/network/head/lstm/first/Gemm", "LSTM"),
        ("/network/head/score/score.2/Gemm", "readout"),
        ("/network/head/Concat_5", "other"),
    ],
)
def test_parts(limits, name, part):
    assert limits.part_of(name) == part


def test_the_parts_of_the_shipped_model_hold_all_its_weights(limits):
    from re3.models import find_weights, list_models

    parameters = next(card.parameters for card in list_models() if card.name == "re3-lite")
    held = limits.weight_bytes(str(find_weights("re3-lite")))
    assert set(held) >= {"trunk", "fully connected", "LSTM", "readout"}
    # The trunk's normalisation lies in its convolutions; a few constants come on top.
    assert sum(held.values()) == pytest.approx(4 * parameters, rel=0.02)
    # What runs by default is in eight bits, but for the score and other small layers.
    eight_bits = limits.weight_bytes("re3-lite")
    assert sum(eight_bits.values()) < 0.4 * sum(held.values())
    assert eight_bits["LSTM"] < 0.3 * held["LSTM"]
    assert eight_bits["readout"] > 0.5 * held["readout"]


def test_convolutions_whose_weights_the_profile_does_not_show(limits):
    kernels = limits.kernel_sizes("re3-lite")
    assert kernels["/network/trunk/stem/stem.0/layer/Conv"] == 3 * 3 * 3
    assert len(kernels) == 54  # all that the network has
    arguments = {
        "op_name": "QLinearConv",
        "input_type_shape": [{"uint8": [1, 4, 4, 3]}, {"float": []}, {"int8": [8]}],
        "output_type_shape": [{"uint8": [1, 2, 2, 8]}],
    }
    assert limits.operations_of(arguments, 27.0) == 2 * 2 * 2 * 8 * 27


def test_the_page_of_figures_keeps_what_is_not_measured_anew(tmp_path, monkeypatch):
    figures = program("figures")
    page = tmp_path / "figures.md"
    monkeypatch.setattr(figures, "PAGE", page)
    assert figures.read() == {}
    sections = {
        name: figures.section(name, f"{name} printed\n\n  this ") for name in ("limits", "video")
    }
    page.write_text("\n".join([figures.HEAD, *sections.values()]))
    assert figures.read() == sections
    assert "```sh\nre3 export re3 FOLDER/paper.onnx --untrained" in sections["limits"]
    assert "video printed\n\n  this\n```" in sections["video"]


def test_no_difference_between_a_network_and_itself(tmp_path):
    torch = pytest.importorskip("torch", reason="writes a network")
    from re3.benchmark.footage import made_footage
    from re3.network.export import export_onnx
    from re3.network.re3 import Re3, Re3Config

    paper = program("paper_network")
    paper.FRAMES = 33  # past a reset
    torch.manual_seed(0)
    path = tmp_path / "plain.onnx"
    export_onnx(Re3(Re3Config(fully_connected=32, lstm_units=16)), path, half_weights=False)
    made = made_footage(4)
    same, moved = paper.compare(path, path, made.frames, made.box_xywh)
    assert same.shape == (33,)
    assert same.max() == 0
    assert moved > 0


def test_scores_of_objects_out_of_sight_are_apart(tmp_path):
    import numpy as np

    from re3.data.hiding import HiddenSequence
    from re3.data.plain import read_folder
    from re3.video import VideoWriter

    rng = np.random.default_rng(0)
    picture = np.repeat(np.repeat(rng.integers(0, 256, (12, 16, 3)), 10, 0), 10, 1)
    with VideoWriter(tmp_path / "clip.mp4", 30, (160, 120)) as writer:
        for _ in range(8):
            writer.write(picture.astype(np.uint8))
    boxes = ["60,40,40,40"] * 8
    boxes[5] = "nan,nan,nan,nan"
    (tmp_path / "clip.txt").write_text("\n".join(boxes) + "\n")
    score = program("score")
    (sequence,) = read_folder(tmp_path)
    (track,) = score.collect([sequence], "re3-lite")
    assert (len(track.scores), len(track.overlaps), len(track.absent_scores)) == (6, 6, 1)
    assert list(track.absent) == [False] * 4 + [True] + [False] * 2  # the first frame is given
    assert len(track.statuses) == 7
    assert track.hidden_from is None
    assert np.isfinite(track.overlaps).all()
    (track,) = score.collect([HiddenSequence.of(sequence, 2, 4)], "re3-lite")
    assert (len(track.scores), len(track.overlaps), len(track.absent_scores)) == (4, 4, 3)
    assert list(track.absent) == [False, True, True, False, True, False, False]
    assert track.hidden_from == 1


def test_alarms_and_the_losses_that_they_notice_are_counted(capsys):
    import numpy as np

    from re3.result import Status

    score = program("score")
    tracked, lost = Status.TRACKED, Status.LOST

    def track(overlaps, statuses, hidden_from=None):
        """Boxes of an overlap each; none is known while the object is hidden."""
        overlap = np.array(overlaps)
        absent = np.isnan(overlap)
        known = overlap[~absent]
        return score.Scores("a", known, known, overlap[absent], statuses, absent, hidden_from)

    nothing = np.nan
    tracks = [
        # A false alarm of two frames, and then a loss that is noticed in its third frame.
        track([0.9] * 5 + [0.0] * 6, [tracked, lost, lost] + [tracked] * 4 + [lost] * 4),
        # Hidden, which goes unnoticed.
        track([0.9] * 3 + [nothing] * 12, [tracked] * 13 + [lost] * 2, hidden_from=3),
    ]
    score._print_called("lost", Status.UNCERTAIN, tracks)
    # 4 of 6 failures, one of two losses, 2 of 12 hidden frames, 2 of 8 good boxes, one alarm.
    printed = " ".join(capsys.readouterr().out.split())
    assert printed == "lost 66.7% 50.0% of 2 16.7% 250.0 125.00"
