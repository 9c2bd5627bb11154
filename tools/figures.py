"""Every picture of the documentation.

    python tools/figures.py                    # all, into docs/images
    python tools/figures.py spread network-re3 # some
    python tools/figures.py --list

Needs the extras "train" and "report". All frames are from Intel IoT DevKit's sample videos
(https://github.com/intel-iot-devkit/sample-videos, CC BY 4.0): the bundled clip, and for some
pictures `car-detection.mp4` and `bottle-detection.mp4`, looked for in the folder of `--clips`.
Weights, thresholds and clips decide what is seen; run it again when one of them changes.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any

import cv2

from re3.evaluation.plots_style import save
from strips import STRIPS, make_strip

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
CLIPS = ROOT.parent / "shared" / "data" / "demo" / "cc-by"
JPEG_QUALITY = 80

DRAWN = {
    "crops.jpg": "method_pictures.crops",
    "heat.jpg": "method_pictures.heat",
    "search.jpg": "method_pictures.search",
    "simulated.jpg": "method_pictures.simulated",
    "scores.svg": "method_pictures.scores",
    "network-re3.svg": "method_diagrams.network_re3",
    "network-re3-lite.svg": "method_diagrams.network_lite",
}
"""File name -> the function that makes it; imported when asked for, as it takes torch with it."""


def main() -> int:
    """Make the figures asked for; 2 where one is unknown or a clip is missing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="figures, without suffix; by default all")
    parser.add_argument("--clips", type=Path, default=CLIPS, help="folder of the sample videos")
    parser.add_argument("--out", type=Path, default=IMAGES)
    parser.add_argument("--list", action="store_true", help="print the names and stop")
    arguments = parser.parse_args()
    files = {Path(file).stem: file for file in (*(f"{name}.jpg" for name in STRIPS), *DRAWN)}
    if arguments.list:
        print("\n".join(files.values()))
        return 0
    if unknown := set(arguments.names) - set(files):
        print(f"no figure is called {', '.join(sorted(unknown))}; there are {', '.join(files)}")
        return 2
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or files:
        path = arguments.out / files[name]
        try:
            write(make(path, arguments.clips), path)
        except FileNotFoundError as error:
            print(f"{name}: {error}")
            return 2
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")
    return 0


def make(path: Path, clips: Path) -> Any:
    """The picture, uint8 `[H, W, 3]` BGR, or the plot that is kept under a path."""
    if path.name not in DRAWN:
        return make_strip(STRIPS[path.stem], clips)
    module, _, function = DRAWN[path.name].partition(".")
    return getattr(importlib.import_module(module), function)(clips)


def write(figure: Any, path: Path) -> None:
    """A picture as JPEG, a plot as SVG."""
    if path.suffix == ".svg":
        save(figure, path)
    elif not cv2.imwrite(str(path), figure, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
        raise OSError(f"OpenCV cannot write {path}")


if __name__ == "__main__":
    sys.exit(main())
