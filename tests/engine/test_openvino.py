"""The engine OpenVINO, where that extra is installed; and what is said where it is not."""

import sys

import numpy as np
import pytest

from re3.engine import find_file, load_engine, zero_state
from re3.models import DEFAULT_MODEL, find_weights


def test_it_runs_the_eight_bits_where_there_are_any():
    assert find_file(DEFAULT_MODEL, "openvino")[0].name == "re3-base-int8.onnx"
    assert find_file(find_weights(DEFAULT_MODEL), "openvino")[0].name == "re3-base.onnx"


def test_a_file_for_openvino_is_run_by_it_alone(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text("<net/>")
    assert find_file(path) == (path, "openvino")
    for engine in ("onnx", "torch"):
        with pytest.raises(ValueError, match=r"model\.xml is for OpenVINO; take the openvino"):
            load_engine(path, engine)


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "openvino", None)
    monkeypatch.delitem(sys.modules, "re3.engine.openvino_engine", raising=False)
    with pytest.raises(ImportError, match=r'pip install "re3\[openvino\]", or take the onnx'):
        load_engine(DEFAULT_MODEL, "openvino")


@pytest.fixture
def _openvino():
    pytest.importorskip("openvino", reason="the extra openvino")


def _walk(engine, objects, steps=3):
    spec, rng = engine.spec, np.random.default_rng(objects)
    state, side = zero_state(spec, objects), spec.current.size
    for _ in range(steps):
        crops = rng.integers(0, 256, (objects, side, side, 3), dtype=np.uint8)
        output = engine.step(None, crops, state)
        state = output.state
    return output


@pytest.mark.usefixtures("_openvino")
def test_it_computes_what_onnx_runtime_computes():
    path = find_weights(DEFAULT_MODEL)
    ours, theirs = load_engine(path, "openvino", threads=1), load_engine(path, "onnx", threads=1)
    assert ours.spec == theirs.spec
    for objects in (1, 3, 1):  # the number may change from step to step
        a, b = _walk(ours, objects), _walk(theirs, objects)
        np.testing.assert_allclose(a.corners, b.corners, atol=0.01)
        np.testing.assert_allclose(a.score, b.score, atol=0.01)
        assert a.corners.shape == (objects, 4)
        for name, shape in ours.spec.state.items():
            assert a.state[name].shape == (objects, *shape)


@pytest.mark.usefixtures("_openvino")
def test_eight_bits_are_near_those_of_onnx_runtime():
    a, b = (_walk(load_engine(DEFAULT_MODEL, name), 2, 1) for name in ("openvino", "onnx-int8"))
    np.testing.assert_allclose(a.corners, b.corners, atol=0.3)  # 3 % of a crop of noise


@pytest.mark.usefixtures("_openvino")
def test_files_that_are_none_are_refused(tmp_path, plain_onnx):
    broken = tmp_path / "broken.xml"
    broken.write_text("<net/>")
    with pytest.raises(ValueError, match=r"broken\.xml cannot be loaded by OpenVINO"):
        load_engine(broken)
    with pytest.raises(FileNotFoundError, match=r"nowhere\.xml does not exist"):
        load_engine(tmp_path / "nowhere.xml", "openvino")
    with pytest.raises(ValueError, match=r"plain\.onnx is a model, but carries no re3"):
        load_engine(plain_onnx, "openvino")
