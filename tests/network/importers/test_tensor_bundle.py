"""The index of a TensorFlow checkpoint, written here block by block."""

import pytest
from typer.testing import CliRunner
from weight_files import message, varint

from re3.apps.cli import app
from re3.network.importers.tensor_bundle import MAGIC, read_shapes

SHAPES = {
    "re3/conv1/W": (11, 11, 3, 96),
    "re3/conv1/b": (96,),
    "re3/fc6/W": (74208, 1024),
    "re3/lstm1/w_f_diag": (512,),
    "step": (),
}
NO_CHECKSUM = b"\0\0\0\0"


def block(entries, *, restart_every=2, compression=0):
    """Keys share what they have in common with the one before, but at restarts."""
    out, restarts, last = b"", [], b""
    for index, (key, value) in enumerate(entries):
        shared = 0
        if index % restart_every == 0:
            restarts.append(len(out))
        else:
            while shared < min(len(key), len(last)) and key[shared] == last[shared]:
                shared += 1
        out += varint(shared) + varint(len(key) - shared) + varint(len(value))
        out += key[shared:] + value
        last = key
    for restart in restarts:
        out += restart.to_bytes(4, "little")
    return out + len(restarts).to_bytes(4, "little"), bytes([compression]) + NO_CHECKSUM


def entry(shape):
    sides = message(*((2, message((1, side))) for side in shape))
    return message((1, 1), (2, sides), (4, 0), (5, 400)) + b"\x351234"


def index_file(shapes, **options):
    """Two data blocks, an empty meta index, the index of blocks, the footer."""
    entries = [(b"", message((1, 1)))]
    entries += [(name.encode(), entry(shape)) for name, shape in sorted(shapes.items())]
    out, places = b"", []
    for part in (entries[:3], entries[3:]):
        content, trailer = block(part, **options)
        places.append((part[-1][0], varint(len(out)) + varint(len(content))))
        out += content + trailer
    footer = b""
    for part in ([], places):
        content, trailer = block(part)
        footer += varint(len(out)) + varint(len(content))
        out += content + trailer
    return out + footer.ljust(40, b"\0") + MAGIC


def test_every_variable_is_listed(tmp_path):
    path = tmp_path / "checkpoint-1.index"
    path.write_bytes(index_file(SHAPES))
    assert read_shapes(path) == SHAPES


@pytest.mark.parametrize("given", ["checkpoint-1", "checkpoint-1.index", "checkpoint-1.meta"])
def test_the_command_lists_them_by_any_name_of_the_checkpoint(tmp_path, given):
    (tmp_path / "checkpoint-1.index").write_bytes(index_file(SHAPES))
    result = CliRunner().invoke(app, ["weights", "show", str(tmp_path / given)])
    assert result.exit_code == 0, result.output
    assert "re3/conv1/W\t11 x 11 x 3 x 96\n" in result.output
    assert "step\tone value\n" in result.output
    assert "5 tensors, 76.0 M values; a TensorFlow checkpoint" in " ".join(result.output.split())


WHOLE = index_file(SHAPES)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "does not end as one"),
        (WHOLE[:-3], "does not end as one"),
        (WHOLE[60:], "more than are there|reaches over its end|restarts"),
        (index_file(SHAPES, compression=1), "the block at byte 0 is compressed"),
    ],
    ids=["empty", "cut off", "without its beginning", "compressed"],
)
def test_a_broken_index_is_named(tmp_path, data, message):
    path = tmp_path / "checkpoint-1.index"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=rf"checkpoint-1\.index cannot be read.*({message})"):
        read_shapes(path)
