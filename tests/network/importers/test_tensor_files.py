"""Files are told apart by content; nothing in them is executed; bad ones are named."""

import os
import pickle

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from typer.testing import CliRunner
from weight_files import caffemodel

from re3.apps.cli import app
from re3.network.importers import import_file
from re3.network.importers.tensor_files import read_tensors

VALUES = {"a.weight": torch.arange(6.0).reshape(2, 3), "steps": torch.tensor(7)}


def save_caffe(values, path):
    path.write_bytes(caffemodel([("a", (values["a.weight"].numpy(), np.zeros(2)))]))


@pytest.mark.parametrize(
    ("name", "save"),
    [
        ("w.pth", torch.save),
        ("w.bin", torch.save),  # told by content
        ("w.safetensors", save_file),
        ("w.caffemodel", save_caffe),
    ],
)
def test_tensors_are_read_whatever_the_file(tmp_path, name, save):
    save(VALUES, tmp_path / name)
    read = read_tensors(tmp_path / name)
    torch.testing.assert_close(read["a.weight"], VALUES["a.weight"], rtol=0, atol=0)


def test_half_precision_becomes_single(tmp_path):
    save_file({"a": torch.tensor([0.1]).half()}, tmp_path / "w.safetensors")
    (value,) = read_tensors(tmp_path / "w.safetensors").values()
    assert value.dtype == torch.float32


class Intruder:
    """Runs a command when a pickle of it is loaded without care."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.mark.parametrize("old_form", [False, True], ids=["zip", "before torch 1.6"])
def test_code_in_a_file_is_not_executed(tmp_path, old_form):
    path, mark = tmp_path / "evil.pth", tmp_path / "ran"
    values = {"conv.0.weight": torch.zeros(1), "payload": Intruder(mark)}
    torch.save(values, path, _use_new_zipfile_serialization=not old_form)
    with pytest.raises(
        ValueError, match=r"evil\.pth holds more than tensors \(.*\w+\.mkdir\), and was not loaded"
    ):
        import_file(path)
    assert not mark.exists()
    torch.load(path, weights_only=False)  # the trap is a real one
    assert mark.exists()


def test_a_bare_pickle_is_not_executed(tmp_path):
    path, mark = tmp_path / "evil.pth", tmp_path / "ran"
    path.write_bytes(pickle.dumps(Intruder(mark), protocol=2))
    with pytest.raises(ValueError, match=r"evil\.pth"):
        import_file(path)
    assert not mark.exists()


def torch_bytes(value, path):
    torch.save(value, path)
    return path.read_bytes()


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("w.pth", lambda p: b"", "is empty; expected a PyTorch file"),
        ("w.pth", lambda p: b"once upon a time", "begins with b'once upo', as no known kind"),
        ("w.h5", lambda p: b"\x89HDF\r\n\x1a\n", "as no known kind does"),
        ("w.pth", lambda p: torch_bytes(VALUES, p)[:-200], "cannot be read as a PyTorch file"),
        ("w.pth", lambda p: torch_bytes([1, 2], p), "holds a list; expected a dict of tensors"),
        (
            "w.pth",
            lambda p: torch_bytes({"state_dict": VALUES}, p),
            "'state_dict' is a dict; expected a plain dict of names and tensors",
        ),
        ("w.safetensors", lambda p: b"\x08\0\0\0\0\0\0\0{broken}", "cannot be read as safetensors"),
        ("w.caffemodel", lambda p: b"\x89HDF\r\n\x1a\n", "as no known kind does"),
        ("w.caffemodel", lambda p: b"<html>nothing</html>", "cannot be read as a Caffe model"),
        ("re3.ckpt.index", lambda p: b"\0", "TensorFlow checkpoint.*not documented"),
        (
            "w.pth",
            lambda p: torch_bytes({"layer1.0.conv1.weight": torch.zeros(1)}, p),
            r"has 1 tensors \(layer1\.0\.conv1\.weight.*of no known network; expected the authors'",
        ),
    ],
    ids=[
        "empty",
        "text",
        "HDF5",
        "cut off",
        "list",
        "nested",
        "safetensors",
        "Caffe in HDF5",
        "page",
        "TensorFlow",
        "another network",
    ],
)
def test_a_file_that_cannot_be_imported_is_named(tmp_path, name, make, message):
    path = tmp_path / name
    path.write_bytes(make(path))
    with pytest.raises(ValueError, match=rf"{name}.*{message}"):
        import_file(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.pth does not exist"):
        import_file(tmp_path / "none.pth")
    with pytest.raises(ValueError, match="is a folder; expected a PyTorch file"):
        import_file(tmp_path)


def test_a_tensorflow_prefix_is_recognised(tmp_path):
    (tmp_path / "checkpoint-1.index").write_bytes(b"\0")
    with pytest.raises(ValueError, match="checkpoint-1 looks like a TensorFlow checkpoint"):
        import_file(tmp_path / "checkpoint-1")


def test_the_command_tells_an_error_in_a_line_and_writes_nothing(tmp_path):
    path = tmp_path / "w.pth"
    path.write_bytes(b"once upon a time")
    command = ["weights", "import", str(path), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2
    assert "begins with b'once upo'" in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()
