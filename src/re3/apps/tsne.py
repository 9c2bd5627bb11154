"""`re3 tsne`: draw how the recurrent state moves while clips are tracked (Re3, Fig. 2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from re3.apps.console import failed, stderr
from re3.models import FAST_MODEL

if TYPE_CHECKING:
    from re3.data.sequence import Sequence


@dataclass(frozen=True, eq=False)
class _Clip:
    """Frames from the first with a box on, that box_xywh `[4]`, and marks of occlusion `[T]`."""

    name: str
    frames: Iterator[NDArray[np.uint8]]
    box_xywh: NDArray[np.float64]
    occluded: NDArray[np.bool_] | None = None


def tsne(
    clips: Annotated[
        list[Path],
        typer.Argument(
            help="With --box, videos or folders of images. Without, annotated ones: a clip with "
            "its boxes beside it, or the folder of a dataset.",
            metavar="CLIP...",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Plot to write: .svg, .pdf or .png.", metavar="FILE"),
    ],
    box: Annotated[
        list[str] | None,
        typer.Option(
            "--box",
            "-b",
            help="The object in the first frame: left, top, width, height in pixels. Once a clip, "
            "in their order.",
            metavar="X,Y,W,H",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        str, typer.Option("--model", "-m", help="A model's name (see `re3 models`) or file.")
    ] = FAST_MODEL,
    max_frames: Annotated[
        int, typer.Option(help="Frames of each clip, from the box on.", min=2)
    ] = 200,
    reset: Annotated[
        bool,
        typer.Option(
            help="Return to the first state every so many frames, as the model does when tracking."
        ),
    ] = True,
    perplexity: Annotated[
        float, typer.Option(help="Of t-SNE: about how many neighbours a frame has.")
    ] = 30.0,
    threads: Annotated[int, typer.Option(help="For the network; 0: all cores but one.", min=0)] = 0,
) -> None:
    """Draw the LSTM's cells and outputs, frame by frame, with t-SNE.

    A path a clip; the first frame is a square, frames marked as occluded are
    circled. Needs the extra "report".

    Examples:

        re3 tsne clip.mp4 --box 120,80,60,140 --out tsne.svg

        re3 tsne data/otb --no-reset --max-frames 100 --out tsne.pdf
    """
    from re3.evaluation import tsne as states
    from re3.evaluation.plots_style import check_suffix, require, save

    try:
        # Before anything is tracked.
        check_suffix(out)
        require("matplotlib")
        require("sklearn")
        paths = []
        tracker = states.recorder(model, reset=reset, threads=threads)
        for clip in _with_boxes(clips, box) if box else _annotated(clips):
            frames = islice(clip.frames, max_frames)
            paths.append(states.record(clip.name, frames, clip.box_xywh, tracker, clip.occluded))
            stderr().print(f"{clip.name}: {len(paths[-1].states)} frames", markup=False)
        save(states.tsne_plot(paths, states.embed(paths, perplexity)), out)
    except (ImportError, OSError, ValueError) as error:
        raise failed(error) from error
    stderr().print(f"{out}: {sum(len(path.states) for path in paths)} states", markup=False)


def _with_boxes(clips: list[Path], boxes: list[str]) -> Iterator[_Clip]:
    from re3.data.plain import clip_name
    from re3.video import open_source

    if len(boxes) != len(clips):
        raise ValueError(f"{len(boxes)} --box for {len(clips)} clips; expected one a clip")
    parsed = [_parse_box(text) for text in boxes]
    for path, box in zip(clips, parsed, strict=True):
        with open_source(path) as source:
            yield _Clip(clip_name(path), (frame.image for frame in source), box)


def _annotated(clips: list[Path]) -> Iterator[_Clip]:
    from re3.data.formats import read_dataset
    from re3.data.plain import read_track, read_tracks
    from re3.evaluation.one_pass import first_annotated

    sequences: list[Sequence] = []
    for path in clips:
        if path.with_suffix(".jsonl").is_file() and not path.is_dir():
            sequences += read_tracks(path)
        elif path.is_file() or path.absolute().with_name(f"{path.absolute().name}.txt").is_file():
            sequences.append(read_track(path))
        else:
            sequences += read_dataset(path)
    for sequence in sequences:
        start = first_annotated(sequence)
        marks = None if sequence.occluded is None else sequence.occluded[start:]
        yield _Clip(
            sequence.name,
            islice(sequence.frames(), start, None),
            sequence.boxes_xywh[start],
            marks,
        )


def _parse_box(text: str) -> NDArray[np.float64]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 4:
        raise ValueError(
            f"--box {text!r} is not X,Y,W,H: four numbers, left, top, width and height in "
            "pixels, separated by commas, such as 120,80,60,140"
        )
    return np.array(numbers)
