"""A workspace of the VOT toolkit on disk: its settings, its sequences and its trackers.

    config.yaml                     the stack, by name, or the file stack.yaml beside it
    trackers.ini                    how to start each tracker, over TraX
    sequences/list.txt              the sequences that take part
    sequences/NAME/sequence         size, length and rate of the frames
    sequences/NAME/groundtruth.txt  x,y,width,height a line, or x,y of each corner of a polygon
    sequences/NAME/color/00000001.png ...
    results/TRACKER/baseline/NAME/NAME_001.txt ...   a trajectory a repetition
    analysis/NAME.json              what `vot analysis` found

It is the layout of vot-toolkit 0.9.0; its own commands (`vot evaluate`, `vot report` ...) work in
such a folder too. What they leave is read by `re3.evaluation.vot_results`.
"""

from __future__ import annotations

import configparser
import re
import shlex
import sys
from collections.abc import Callable, Iterable
from collections.abc import Sequence as List
from pathlib import Path

import cv2
import numpy as np

from re3.data.sequence import Sequence
from re3.evaluation.vot import STACKS, VotStack
from re3.evaluation.vot_toolkit import absolute_python_path

EXPERIMENT = "baseline"
FPS = 30
_TIMEOUT = 120
"""Seconds a tracker has for an answer; loading a network on a busy machine takes a while."""


def write_config(workspace: Path, stack: VotStack) -> None:
    """Write `config.yaml`, and `stack.yaml` where the stack is not one of the toolkit's own."""
    workspace.mkdir(parents=True, exist_ok=True)
    name = stack.toolkit_name
    if STACKS.get(stack.name) != stack:
        name = "./stack.yaml"
        (workspace / "stack.yaml").write_text(_stack_text(stack), encoding="utf-8")
    (workspace / "config.yaml").write_text(
        f"registry:\n- ./trackers.ini\nsequences: sequences\nstack: {name}\n", encoding="utf-8"
    )
    (workspace / "results").mkdir(exist_ok=True)


def write_sequences(
    workspace: Path, sequences: List[Sequence], on_frame: Callable[[int], None] | None = None
) -> dict[str, Sequence]:
    """Write sequences, those that are there already left as they are, and `list.txt`.

    Images are written as PNG, so the trackers get the pixels they get in our own evaluations.

    Args:
        workspace: its folder.
        sequences: with a box in every frame: the toolkit would call each frame without one a
            failure.
        on_frame: called with the number of frames done in all, after each.

    Returns:
        the sequences by the name they have in the workspace.

    Raises:
        ValueError: no sequence, one with a frame without box or with frames of several sizes,
            frames that cannot be read, two of one name, or one that differs from what the
            workspace holds under its name.
    """
    named = _name_sequences(sequences)
    done = 0
    for name, sequence in named.items():
        if not sequence.annotated.all():
            raise ValueError(
                f"sequence {name!r} has no box in {int((~sequence.annotated).sum())} of its "
                f"{len(sequence)} frames; expected one in each: leave it out"
            )
        folder = workspace / "sequences" / name
        if (folder / "sequence").is_file():
            _check_same(folder, sequence)
        else:
            _write_sequence(folder, sequence, on_frame and _offset(on_frame, done))
        done += len(sequence)
        if on_frame is not None:
            on_frame(done)
    (workspace / "sequences" / "list.txt").write_text(
        "".join(f"{name}\n" for name in named), encoding="utf-8"
    )
    return named


def write_trackers(
    workspace: Path, trackers: Iterable[tuple[str, str]], peers: Path | None = None
) -> dict[str, str]:
    """Enter trackers in `trackers.ini`, each as our TraX server run by this Python.

    Trackers entered before stay, so that reports can compare all that have results.

    Args:
        workspace: its folder.
        trackers: of each the name it is reported by, and what `find_tracker` was asked for.
        peers: folder with the files of peer trackers.

    Returns:
        the names trackers are reported by, by their identifiers in the toolkit, which allow
        letters, digits, `-` and `_` alone.

    Raises:
        ValueError: two trackers get the same identifier.
    """
    registry = configparser.ConfigParser(interpolation=None)
    registry.read(workspace / "trackers.ini", encoding="utf-8")
    names: dict[str, str] = {}
    for name, asked in trackers:
        identifier = _identifier(name)
        if identifier in names:
            raise ValueError(
                f"trackers {names[identifier]!r} and {name!r} are both {identifier!r} to the "
                "toolkit; give a model file a name of its own as NAME=MODEL.onnx"
            )
        names[identifier] = name
        # The toolkit starts trackers in a folder of their own, where relative paths lead nowhere.
        server = [sys.executable, "-m", "re3.apps.trax_server", "--tracker", asked]
        server += ["--directory", str(Path.cwd())]
        if peers is not None:
            server += ["--peers", str(peers)]
        entry = {
            "label": name,
            "protocol": "trax",
            "command": shlex.join(server),
            "timeout": str(_TIMEOUT),
        }
        if path := absolute_python_path():
            entry["env_pythonpath"] = path
        # The toolkit reads the file with interpolation, where a percent sign is doubled.
        registry[identifier] = {key: value.replace("%", "%%") for key, value in entry.items()}
    with (workspace / "trackers.ini").open("w", encoding="utf-8") as file:
        registry.write(file)
    return names


def _stack_text(stack: VotStack) -> str:
    lines = [
        f"title: {stack.name}, changed by re3",
        "experiments:",
        f"  {EXPERIMENT}:",
        "    type: supervised",
        f"    repetitions: {stack.repetitions}",
        f"    skip_initialize: {stack.restart_after}",
        "    analyses:",
        "      - type: supervised_average_ar",
        f"        sensitivity: {stack.sensitivity:g}",
        f"        burnin: {stack.burn_in}",
        "      - type: cumulative_failures",
    ]
    if stack.interval is not None:
        lines += [
            "      - type: supervised_eao_score",
            f"        low: {stack.interval[0]}",
            f"        high: {stack.interval[1]}",
            "      - type: supervised_eao_curve",
        ]
    return "".join(f"{line}\n" for line in lines)


def _name_sequences(sequences: List[Sequence]) -> dict[str, Sequence]:
    """Sequences by a name that can be a folder's; with the dataset's where two are called alike."""
    if not sequences:
        raise ValueError("no sequences; expected one or more")
    names = [_folder_name(sequence.name) for sequence in sequences]
    if len(set(names)) < len(names):
        names = [_folder_name(f"{s.dataset}-{s.name}") for s in sequences]
    named = dict(zip(names, sequences, strict=True))
    if len(named) < len(sequences):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(
            f"two sequences are called {twice!r}; expected different names: is a folder given "
            "twice?"
        )
    return named


def _folder_name(name: str) -> str:
    # The toolkit's --sequences separates names by commas, and a glob of it must not match others.
    return re.sub(r"[^\w.+-]", "-", name).lstrip(".") or "sequence"


def _identifier(name: str) -> str:
    return re.sub(r"[^a-zA-Z0-9_-]", "_", name)


def _write_sequence(
    folder: Path, sequence: Sequence, on_frame: Callable[[int], None] | None
) -> None:
    images = folder / "color"
    images.mkdir(parents=True, exist_ok=True)
    size: tuple[int, int] | None = None
    for number, frame in enumerate(sequence.frames(), start=1):
        height, width = frame.shape[:2]
        if size is not None and size != (width, height):
            raise ValueError(
                f"sequence {sequence.name!r}: frame {number - 1} is {width} x {height}, the first "
                f"{size[0]} x {size[1]}; expected frames of one size"
            )
        size = (width, height)
        path = images / f"{number:08d}.png"
        # Level 1 takes 15 ms for a frame of 768 x 432 where the default takes 40.
        if not cv2.imwrite(str(path), frame, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
            raise OSError(f"{path} cannot be written")
        if on_frame is not None:
            on_frame(number)
    assert size is not None, "a sequence has at least one frame"
    (folder / "groundtruth.txt").write_text(_truth_text(sequence), encoding="utf-8")
    properties = {
        "name": folder.name,
        "channels.color": "color/%08d.png",
        "fps": FPS,
        "length": len(sequence),
        "width": size[0],
        "height": size[1],
    }
    # This file comes last: where it is, the sequence is complete.
    (folder / "sequence").write_text(
        "".join(f"{key}={value}\n" for key, value in properties.items()), encoding="utf-8"
    )


def _truth_text(sequence: Sequence) -> str:
    polygons = sequence.polygons or (None,) * len(sequence)
    rows = (
        box if polygon is None else polygon.ravel()
        for box, polygon in zip(sequence.boxes_xywh, polygons, strict=True)
    )
    lines = (",".join(np.format_float_positional(v, trim="-") for v in row) for row in rows)
    return "".join(f"{line}\n" for line in lines)


def _check_same(folder: Path, sequence: Sequence) -> None:
    written = (folder / "groundtruth.txt").read_text(encoding="utf-8")
    if written != _truth_text(sequence):
        raise ValueError(
            f"{folder} holds another sequence, or one with other truth, than {sequence.name!r}; "
            "expected the same: give another --workspace, or delete the folder and its results"
        )


def _offset(on_frame: Callable[[int], None], done: int) -> Callable[[int], None]:
    return lambda frames: on_frame(done + frames)
