"""The shipped model by its engines, and files that are none."""

import os
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

import re3
from re3.engine import find_file, load_engine, zero_state
from re3.engine.threads import usable_threads
from re3.geometry import iou_xywh
from re3.models import DEFAULT_MODEL, find_weights, list_models
from re3.video import open_source

CLIP = Path(__file__).parents[2] / "examples" / "clips" / "person.mp4"
PERSON = (368.0, 58.0, 158.0, 374.0)


def test_torch_and_onnx_agree_on_a_step():
    pytest.importorskip("torch", reason="compares with the torch engine")
    engines = [load_engine(DEFAULT_MODEL, name) for name in ("onnx", "torch")]
    spec, rng = engines[0].spec, np.random.default_rng(0)
    assert engines[1].spec == spec
    for objects in (1, 3):
        states = [zero_state(spec, objects)] * 2
        for _ in range(3):
            side = spec.current.size
            crops = rng.integers(0, 256, (objects, side, side, 3), dtype=np.uint8)
            a, b = (e.step(None, crops, s) for e, s in zip(engines, states, strict=True))
            np.testing.assert_allclose(a.corners, b.corners, atol=1e-4)
            np.testing.assert_allclose(a.score, b.score, atol=1e-4)
            for name in spec.state:
                np.testing.assert_allclose(
                    a.state[name], b.state[name], rtol=1e-3, atol=1e-3, err_msg=name
                )
            states = [a.state, b.state]


@pytest.mark.slow
def test_torch_and_onnx_give_the_same_boxes_over_a_clip():
    pytest.importorskip("torch", reason="compares with the torch engine")
    trackers = [re3.Tracker(engine=name) for name in ("onnx", "torch")]
    with open_source(CLIP) as source:
        for frame in source:
            if frame.index == 0:
                boxes = [t.init(frame.image, PERSON).box_xywh for t in trackers]
            else:
                boxes = [t.update(frame.image).box_xywh for t in trackers]
            np.testing.assert_allclose(boxes[0], boxes[1], atol=0.5)


@pytest.mark.parametrize("engine", ["onnx", "torch"])
def test_a_foreign_onnx_file_is_refused(plain_onnx, engine):
    if engine == "torch":
        pytest.importorskip("torch", reason="the torch engine")
    path = plain_onnx
    onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])  # it is sound
    with pytest.raises(ValueError, match=r"plain\.onnx .*carries no re3 description"):
        load_engine(str(path), engine)


def test_a_broken_onnx_file_is_refused(tmp_path):
    path = tmp_path / "broken.onnx"
    path.write_bytes(find_weights(DEFAULT_MODEL).read_bytes()[:5000])
    with pytest.raises(ValueError, match=r"broken\.onnx cannot be loaded.*complete"):
        load_engine(str(path), "onnx")


@pytest.mark.parametrize(
    ("model", "engine", "error", "message"),
    [
        (
            "re3-lite",
            "cuda",
            ValueError,
            "unknown engine 'cuda'; expected one of auto, onnx-int8",
        ),
        (
            "re4",
            "auto",
            ValueError,
            "unknown model 're4'; expected one of re3-base, re3-lite, re3,",
        ),
        ("re3", "auto", ValueError, "'re3' comes without weights"),
        ("re3", "onnx-int8", ValueError, "'re3' comes without weights"),
        ("nowhere.onnx", "auto", FileNotFoundError, r"nowhere\.onnx does not exist"),
    ],
)
def test_unknown_models_and_engines_are_refused(model, engine, error, message):
    with pytest.raises(error, match=message):
        re3.Tracker(model, engine)


@pytest.mark.parametrize(
    ("engine", "file"),
    [
        ("auto", "re3-lite-int8.onnx"),
        ("onnx-int8", "re3-lite-int8.onnx"),
        ("onnx", "re3-lite.onnx"),
        ("torch", "re3-lite.onnx"),
    ],
)
def test_each_engine_has_its_file(engine, file):
    path, chosen = find_file("re3-lite", engine)
    assert path.name == file
    assert chosen == ("onnx-int8" if engine == "auto" else engine)


def test_a_file_in_full_precision_is_not_run_in_eight_bits():
    path = find_weights("re3-lite")
    assert find_file(path)[1] == "onnx"
    with pytest.raises(ValueError, match="has no file in eight bits; write one with `re3 export"):
        load_engine(path, "onnx-int8")


def test_eight_bits_find_nearly_the_same_box():
    boxes = []
    with open_source(CLIP) as source:
        frames = [frame.image for frame, _ in zip(source, range(10), strict=False)]
    for engine in ("onnx-int8", "onnx"):
        tracker = re3.Tracker(engine=engine)
        tracker.init(frames[0], PERSON)
        boxes.append([tracker.update(frame).box_xywh for frame in frames[1:]])
    assert iou_xywh(boxes[0], boxes[1]).min() > 0.9
    assert boxes[0] != boxes[1]


@pytest.mark.parametrize(("cores", "threads"), [(1, 1), (2, 1), (3, 2), (5, 4), (64, 4)])
def test_one_core_is_left_to_others(monkeypatch, cores, threads):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)), raising=False)
    assert usable_threads() == threads


def test_the_shipped_model_has_a_card_with_figures():
    card = next(card for card in list_models() if card.name == DEFAULT_MODEL)
    assert card.shipped
    assert 1e6 < card.size_bytes < 25e6
    assert card.accuracy["val/davis AUC"] > 0.428  # the first box for ever
    for key in ("command", "data", "machine", "licence"):
        assert card.details[key], key


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("objects", [2, 5, 11])
def test_each_of_several_objects_gets_what_it_would_get_alone(objects, threads):
    engine = load_engine(DEFAULT_MODEL, threads=threads)
    spec, rng = engine.spec, np.random.default_rng(objects)
    side = spec.current.size
    crops = rng.integers(0, 256, (objects, side, side, 3), dtype=np.uint8)
    state = zero_state(spec, objects)
    for _ in range(2):
        together = engine.step(None, crops, state)
        for index in range(objects):
            one = slice(index, index + 1)
            alone = engine.step(None, crops[one], {k: v[one] for k, v in state.items()})
            np.testing.assert_allclose(together.corners[one], alone.corners, atol=1e-4)
            np.testing.assert_allclose(together.score[one], alone.score, atol=1e-4)
            for name, values in alone.state.items():
                np.testing.assert_allclose(together.state[name][one], values, atol=1e-3)
        state = together.state
