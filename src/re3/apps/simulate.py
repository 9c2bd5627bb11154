"""`re3 simulate`: write a synthetic sequence as a video, to look at what training sees."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from re3.apps.console import failed, stderr
from re3.apps.sequences import STILL_FORMAT_HELP
from re3.apps.training_data import show_notes
from re3.data.leaving import MANY_FRAMES
from re3.data.simulation_config import WAYS, SimulationConfig

ANY = "any"
"""What `--leaves` is for one of the ways, at random."""


def simulate(
    stills: Annotated[
        Path,
        typer.Option(
            help="Folder of pictures, annotated in any format of --format or not at all.",
            metavar="DIR",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Video to write (.mp4); boxes go beside it as .txt."),
    ],
    frames: Annotated[int, typer.Option(help="Length of the clip.", min=1)] = 96,
    seed: Annotated[int, typer.Option(help="Another seed, another clip.", min=0)] = 0,
    width: Annotated[int, typer.Option(help="Width of the video in pixels.", min=64)] = 640,
    format_name: Annotated[
        str | None,
        typer.Option("--format", help=STILL_FORMAT_HELP, metavar="NAME", show_default=False),
    ] = None,
    leaves: Annotated[
        str | None,
        typer.Option(
            help=f"Let the object go out of sight: {', '.join(WAYS)}, or any. Default: it stays.",
            metavar="WAY",
            show_default=False,
        ),
    ] = None,
    draw: Annotated[
        bool, typer.Option(help="Draw the object's box, and a red border where it is out of sight.")
    ] = True,
) -> None:
    """Simulate a tracked object from still pictures: motion, camera, occluders, look-alikes.

    Example:

        re3 simulate --stills pictures --out clip.mp4 --seed 3
    """
    from re3.data.contact_sheet import ABSENT
    from re3.data.simulator import simulate as simulate_scene
    from re3.data.still_formats import read_stills
    from re3.geometry import convert
    from re3.result import Result, Status
    from re3.video import VideoWriter, draw_results

    try:
        config = SimulationConfig() if leaves is None else _leaving(leaves, frames)
        pictures = read_stills(stills, format_name)
        show_notes(pictures)
        scene = simulate_scene(pictures, frames, np.random.default_rng(seed), config)
        scale = width / scene.size[0]
        height = max(2, round(scene.size[1] * scale))
        boxes = convert(scene.boxes_xyxy * scale, "xyxy", "xywh")
        with VideoWriter(out, 30, (width, height)) as writer:
            for t in range(frames):
                image = scene.render(t, (0, 0, *scene.size), width, height)
                x, y, w, h = (float(v) for v in boxes[t])
                if draw and np.isfinite(x):
                    visible = float(scene.visible[t])
                    shown = Result((x, y, w, h), visible, Status.TRACKED, t, 0, "visible")
                    image = draw_results(image, [shown])
                elif draw:
                    cv2.rectangle(image, (0, 0), (width - 1, height - 1), ABSENT, 3)
                writer.write(image)
        text = "".join(",".join(f"{v:.2f}" for v in box) + "\n" for box in boxes)
        out.with_suffix(".txt").write_text(text, encoding="utf-8")
    except (OSError, ValueError) as error:
        raise failed(error) from error
    stderr().print(
        f"{out}: {frames} frames of {width} x {height}; boxes in {out.with_suffix('.txt')}",
        markup=False,
    )


def _leaving(way: str, frames: int) -> SimulationConfig:
    """Scenes that the object leaves."""
    if way not in (*WAYS, ANY):
        raise ValueError(f"--leaves is {way!r}; expected {', '.join(WAYS)} or {ANY}")
    if frames <= MANY_FRAMES:
        raise ValueError(
            f"--leaves with --frames {frames}; expected {MANY_FRAMES + 1} frames or more, so that "
            "there is time to go"
        )
    return SimulationConfig(leaves=1.0, leaves_by=WAYS if way == ANY else (way,))
