"""`re3 simulate`: write a synthetic sequence as a video, to look at what training sees."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from re3.apps.console import failed, stderr
from re3.apps.sequences import STILL_FORMAT_HELP


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
    draw: Annotated[bool, typer.Option(help="Draw the object's box.")] = True,
) -> None:
    """Simulate a tracked object from still pictures: motion, camera, occluders, look-alikes.

    Example:

        re3 simulate --stills pictures --out clip.mp4 --seed 3
    """
    from re3.data.simulator import simulate as simulate_scene
    from re3.data.still_formats import read_stills
    from re3.geometry import convert
    from re3.result import Result, Status
    from re3.video import VideoWriter, draw_results

    try:
        scene = simulate_scene(
            read_stills(stills, format_name), frames, np.random.default_rng(seed)
        )
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
                writer.write(image)
        text = "".join(",".join(f"{v:.2f}" for v in box) + "\n" for box in boxes)
        out.with_suffix(".txt").write_text(text, encoding="utf-8")
    except (OSError, ValueError) as error:
        raise failed(error) from error
    stderr().print(
        f"{out}: {frames} frames of {width} x {height}; boxes in {out.with_suffix('.txt')}",
        markup=False,
    )
