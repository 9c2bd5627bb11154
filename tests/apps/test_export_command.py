"""`re3 export`: what it writes can be tracked with, here and in other runtimes."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
import pytest
from typer.testing import CliRunner

import re3
from re3.apps.cli import app
from re3.engine import find_file, load_engine, zero_state

pytest.importorskip("torch", reason="writes networks")

CLIP = Path(__file__).parents[2] / "examples" / "clips" / "person.mp4"
BOX = (368, 58, 158, 374)

MODELS = ("re3-lite", "re3-base")


def export(*arguments):
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


@pytest.fixture(scope="module", params=MODELS)
def exported(request, tmp_path_factory):
    """A model as ONNX, with what comes beside it."""
    path = tmp_path_factory.mktemp("export") / "mine.onnx"
    result = export(request.param, path)
    assert result.exit_code == 0, result.output
    return path


def card_of(path):
    return path.with_name(f"{path.name}.json")


def test_every_file_has_a_card_of_its_own(tmp_path):
    for name, form in (("m.onnx", "onnx"), ("m.pt", "torchscript"), ("m.ts", "torchscript")):
        result = export("re3-lite", tmp_path / name, "--no-examples")
        assert result.exit_code == 0, result.output
        assert f"beside it: {name}.json" in result.output
        assert json.loads((tmp_path / f"{name}.json").read_text())["format"] == form
    cards = sorted(path.name for path in tmp_path.glob("*.json"))
    assert cards == ["m.onnx.json", "m.pt.json", "m.ts.json"]
    assert json.loads((tmp_path / "m.onnx.json").read_text())["format"] == "onnx"


def first_frames(count):
    video = cv2.VideoCapture(str(CLIP))
    return [video.read()[1] for _ in range(count)]


def crops_of(spec, objects):
    rng = np.random.default_rng(0)
    side = spec.current.size
    return rng.integers(0, 256, (objects, side, side, 3), dtype=np.uint8)


def test_the_card_says_what_the_graph_has(exported):
    card = json.loads(card_of(exported).read_text())
    session = onnxruntime.InferenceSession(exported, providers=["CPUExecutionProvider"])
    for kind, found in (("inputs", session.get_inputs()), ("outputs", session.get_outputs())):
        told = {tensor["name"]: tensor for tensor in card[kind]}
        assert list(told) == [tensor.name for tensor in found]
        for tensor in found:
            assert (
                tensor.type
                == {"uint8": "tensor(uint8)", "float32": "tensor(float)"}[told[tensor.name]["type"]]
            )
            assert list(tensor.shape) == told[tensor.name]["shape"]
    assert card["state"]["reset_interval"] == 32
    assert card["state"]["kept_at_reset"] == ["view"]
    assert card["file"] == "mine.onnx"
    assert card["trained"] is True


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("opset", [13, 20])
def test_other_opsets_compute_the_same(tmp_path, opset, model):
    path = tmp_path / "other.onnx"
    result = export(model, path, "--opset", opset, "--no-examples")
    assert result.exit_code == 0, result.output
    assert not (tmp_path / "track_onnx.py").exists()
    engines = [load_engine(model, "onnx"), load_engine(path)]
    spec = engines[0].spec
    assert engines[1].spec == spec
    steps = [engine.step(None, crops_of(spec, 2), zero_state(spec, 2)) for engine in engines]
    np.testing.assert_allclose(steps[0].corners, steps[1].corners, atol=1e-4)


@pytest.mark.parametrize("model", MODELS)
def test_torchscript_computes_the_same_for_any_number_of_objects(tmp_path, model):
    import torch

    path = tmp_path / "mine.pt"
    result = export(model, path)
    assert result.exit_code == 0, result.output
    told = {"re3_spec": ""}
    module = torch.jit.load(str(path), _extra_files=told)
    engine = load_engine(model, "onnx")
    assert told["re3_spec"].decode() == engine.spec.to_json()
    card = json.loads(card_of(path).read_text())
    assert card["inputs"][0]["name"] == "current_crops"
    for objects in (1, 3):
        crops, state = crops_of(engine.spec, objects), zero_state(engine.spec, objects)
        with torch.no_grad():
            given = (torch.from_numpy(v) for v in (crops, *state.values()))
            corners, score, *new = module(*given)
        expected = engine.step(None, crops, state)
        np.testing.assert_allclose(corners, expected.corners, atol=1e-3)
        np.testing.assert_allclose(score, expected.score, atol=1e-3)
        names = [tensor["name"] for tensor in card["outputs"][2:]]
        for name, values in zip(names, new, strict=True):
            np.testing.assert_allclose(
                values, expected.state[name.removeprefix("new_")], atol=1e-3, err_msg=name
            )


def test_openvino_computes_nearly_the_same(tmp_path):
    pytest.importorskip("openvino", reason="the extra openvino")
    path = tmp_path / "mine.xml"
    result = export("re3-lite", path)
    assert result.exit_code == 0, result.output
    assert path.with_suffix(".bin").is_file()
    engine = load_engine("re3-lite", "onnx")
    crops, state = crops_of(engine.spec, 2), zero_state(engine.spec, 2)
    found = load_engine(path).step(None, crops, state)
    np.testing.assert_allclose(found.corners, engine.step(None, crops, state).corners, atol=0.01)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["re3-lite", "mine.bin"], "mine.bin names no format by its end; expected onnx: .onnx"),
        (["re3-lite", "mine.xml", "--format", "onnx"], "mine.xml is no file of format onnx"),
        (["re3", "mine.onnx"], "comes without weights"),
        (["re3", "mine.onnx"], "--untrained"),
        (["re9", "mine.onnx", "--untrained"], "unknown variant 're9'"),
        (["re3-lite", "mine.onnx", "--int8"], "a folder of annotated clips with --calibrate"),
        (["re3-lite", "mine.pt", "--int8"], "--int8 is of an ONNX graph"),
        (["re3-lite", "mine.onnx", "--opset", "9"], "opset is 9; expected 13 to 20"),
        (["gone.safetensors", "mine.onnx"], "gone.safetensors does not exist"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    result = export(*arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert not list(tmp_path.iterdir())


def test_8_bit_weights_are_tracked_with(tmp_path, monkeypatch):
    from re3.network.re3 import Re3, Re3Config

    small = Re3(Re3Config(fully_connected=256, lstm_units=256))
    monkeypatch.setattr("re3.network.untrained.build_untrained", lambda name: small)
    path = tmp_path / "paper.onnx"
    result = export("re3", path, "--int8", "--untrained", "--no-examples")
    assert result.exit_code == 0, result.output
    card = json.loads(card_of(path).read_text())
    assert card["trained"] is False
    weights = sum(each.numel() for each in small.parameters())
    apart = tmp_path / "paper.onnx.data"
    # The convolutions stay as they are, 2.3 million weights of 32 bits.
    assert weights < apart.stat().st_size < weights + 3 * 2.6e6 + 1e5
    assert f"paper.onnx: {(apart.stat().st_size + path.stat().st_size) / 1e6:.1f} MB" in (
        result.output
    )
    csv = tmp_path / "boxes.csv"
    options = ["--box", "368,58,158,374", "--max-frames", 3, "--results", csv]
    result = CliRunner().invoke(app, ["track", str(CLIP), "--model", str(path), *map(str, options)])
    assert result.exit_code == 0, result.output
    assert len(csv.read_text().splitlines()) == 1 + 3


def boxes_of(text):
    return np.array([[float(v) for v in line.split(",")] for line in text.split()])


def python_boxes(model):
    command = [sys.executable, model.parent / "track_onnx.py", model, CLIP]
    done = subprocess.run(
        [*command, ",".join(map(str, BOX))], capture_output=True, text=True, check=True
    )
    return boxes_of(done.stdout)


@pytest.mark.slow
def test_the_python_example_tracks_as_re3_does(exported):
    found = python_boxes(exported)
    tracker = re3.Tracker(str(exported), search=False, framing=False)
    video, results = cv2.VideoCapture(str(CLIP)), []
    while (read := video.read())[0]:
        follow = tracker.update if results else lambda frame: tracker.init(frame, BOX)
        results.append(follow(read[1]))
    assert len(found) == len(results)
    # The example has no statuses: it does not hold the sides of a box that is uncertain.
    sure = [result.status is re3.Status.TRACKED for result in results]
    length = sure.index(False) if False in sure else len(sure)
    assert length > 100
    boxes = np.array([result.box_xywh for result in results[:length]])
    overlap = re3.geometry.iou_xywh(found[:length], boxes)
    # Crops are averaged in another way here: boxes may differ, the object may not.
    assert overlap.min() > 0.8
    assert np.median(overlap) > 0.95


def onnxruntime_headers():
    """The folder of ONNX Runtime's C++ headers; Python's package has only the library."""
    given = os.environ.get("ONNXRUNTIME_INCLUDE")
    usual = ("/usr/include/onnxruntime", "/usr/local/include/onnxruntime", "/usr/local/include")
    for folder in [given] if given else usual:
        if (Path(folder) / "onnxruntime_cxx_api.h").is_file():
            return folder
    return pytest.skip("needs ONNX Runtime's C++ headers; set ONNXRUNTIME_INCLUDE to their folder")


@pytest.mark.slow
def test_the_cpp_example_finds_the_boxes_of_the_python_example(exported, tmp_path):
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("needs a C++ compiler")
    headers = onnxruntime_headers()
    libraries = list((Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so.*"))
    if not libraries:
        pytest.skip("this package of ONNX Runtime has no library to link with")
    for name in ("libonnxruntime.so", "libonnxruntime.so.1"):
        (tmp_path / name).symlink_to(libraries[0])
    program = tmp_path / "track_onnx"
    source = exported.parent / "track_onnx.cpp"
    subprocess.run(
        [
            *(compiler, "-std=c++17", "-O2", "-Wall", "-Werror", source, "-isystem", headers),
            *("-L", tmp_path, "-lonnxruntime", f"-Wl,-rpath,{tmp_path}", "-o", program),
        ],
        check=True,
    )
    video, frames = cv2.VideoCapture(str(CLIP)), []
    while (read := video.read())[0]:
        frames.append(read[1])
    height, width = frames[0].shape[:2]
    done = subprocess.run(
        [program, exported, str(width), str(height), *map(str, BOX)],
        input=b"".join(frame.tobytes() for frame in frames),
        stdout=subprocess.PIPE,
        check=True,
    )
    np.testing.assert_allclose(
        boxes_of(done.stdout.decode()), python_boxes(exported), atol=0.5, rtol=0
    )


@pytest.mark.parametrize("model", MODELS)
def test_our_models_in_eight_bits_are_calibrated_on_clips(tmp_path, model):
    clips, out = tmp_path / "clips", tmp_path / "small.onnx"
    clips.mkdir()
    shutil.copyfile(CLIP, clips / "person.mp4")
    (clips / "person.txt").write_text("368,58,158,374\n" * 40)
    result = export(model, out, "--int8", "--calibrate", clips, "--no-examples")
    assert result.exit_code == 0, result.output
    assert "8-bit integers" in json.loads(card_of(out).read_text())["weights"]
    assert out.stat().st_size < find_file(model, "onnx")[0].stat().st_size
    engine, exact = load_engine(out), load_engine(model, "onnx")
    crops = crops_of(engine.spec, 2)
    corners = [e.step(None, crops, zero_state(e.spec, 2)).corners for e in (engine, exact)]
    np.testing.assert_allclose(*corners, atol=0.5)  # of crops that are noise


def test_clips_to_calibrate_on_are_for_re3_lite_alone(tmp_path):
    result = export("re3", tmp_path / "a.onnx", "--int8", "--untrained", "--calibrate", tmp_path)
    assert result.exit_code == 2
    assert "--calibrate is for re3-lite with --int8" in " ".join(result.output.split())
