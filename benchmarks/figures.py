"""Runs every measurement of speed and writes what each printed to docs/speed-figures.md.

    python benchmarks/figures.py                 # all: about half an hour on a quiet machine
    python benchmarks/figures.py --only limits   # one anew, the others stay as they are

Run it on a machine that does nothing else. Needs `pip install -e ".[train,report,openvino]"`.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "speed-figures.md"
PLOT = "docs/images/speed.png"

HEAD = """# What the measurements of speed printed

Written by `python benchmarks/figures.py`; each section has its command, run in a checkout, and what
it printed, which names the machine and the date. [Speed](speed.md) says what follows from them.
"""

SECTIONS = {
    "bench": f"re3 bench --threads 1,2 --crop-sizes 96,144,192,240,288 --rounds 7 --plot {PLOT}",
    "engines": "re3 bench -m re3-lite --engines onnx-int8,openvino,onnx,torch --threads 2 "
    "--objects 1,10 --rounds 7 --peers none",
    "footprint": "python benchmarks/footprint.py",
    "limits": "python benchmarks/limits.py --model re3-lite --model FOLDER/paper.onnx "
    "--model FOLDER/paper-int8.onnx",
    "paper": "python benchmarks/paper_network.py --rounds 9",
    "video": "python benchmarks/whole_video.py",
}
"""Section -> command; FOLDER is where the paper's network lies."""

PAPER = (
    "re3 export re3 FOLDER/paper.onnx --untrained --no-half --no-examples",
    "re3 export re3 FOLDER/paper-int8.onnx --untrained --int8 --no-examples",
)


def main() -> None:
    """Run the sections asked for and put them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", action="append", choices=list(SECTIONS))
    chosen = parser.parse_args().only or list(SECTIONS)
    found = read()
    with tempfile.TemporaryDirectory() as folder:
        if "limits" in chosen:
            for command in PAPER:
                run(command.replace("FOLDER", folder))
        for name in chosen:
            print(f"{name}: {SECTIONS[name]}", flush=True)
            printed = run(SECTIONS[name].replace("FOLDER", folder)).replace(folder, "FOLDER")
            if name == "bench":
                reduce_colours(ROOT / PLOT)
            found[name] = section(name, printed.replace(f"{ROOT}/", ""))
            # Written after each: a run that is stopped keeps what it has.
            PAGE.write_text("\n".join([HEAD, *(found[n] for n in SECTIONS if n in found)]))


def reduce_colours(path: Path) -> None:
    """Keep a plot in 64 colours, a third of the bytes."""
    from PIL import Image

    with Image.open(path) as plot:
        plot.convert("RGB").quantize(64).save(path, optimize=True)


def read() -> dict[str, str]:
    """The sections that the page has, by name."""
    text = PAGE.read_text(encoding="utf-8") if PAGE.is_file() else ""
    parts = re.split(r"(?m)^(?=## )", text)[1:]
    return {part.split("\n", 1)[0].removeprefix("## "): part.rstrip("\n") + "\n" for part in parts}


def section(name: str, printed: str) -> str:
    """A section of the page."""
    lines = [line.rstrip() for line in printed.rstrip().splitlines()]
    commands = [SECTIONS[name]]
    if "FOLDER" in SECTIONS[name]:
        commands = [*PAPER, *commands]
    return "\n".join([f"## {name}", "", "```sh", *commands, "```", "", "```", *lines, "```", ""])


def run(command: str) -> str:
    """What a command prints on standard output.

    Raises:
        CalledProcessError: it failed; its message is on standard error.
    """
    program, *words = command.split()
    start = [sys.executable, "-m", "re3"] if program == "re3" else [sys.executable]
    done = subprocess.run([*start, *words], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    return done.stdout


if __name__ == "__main__":
    main()
