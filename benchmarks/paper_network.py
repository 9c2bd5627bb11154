"""The paper's network with 8-bit weights: speed, memory, and how far its boxes are from fp32.

    python benchmarks/paper_network.py

Weights are random (`re3.network.untrained`), none ship. Speed: the step of eager torch, of ONNX
Runtime in fp32 and with 8-bit weights, in turns on the same frames. Memory: of a fresh process
without torch that tracks. Boxes: 200 frames in which both networks see the same crops, about the
made object's true box or the bundled clip's first one, and each goes on with its own recurrent
state, reset as in tracking: with random weights boxes of one's own would soon be about nothing.
Needs `pip install -e ".[train]"`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from re3.benchmark.footage import Footage

ROOT = Path(__file__).parents[1]
CLIP, CLIP_BOX = ROOT / "examples" / "clips" / "person.mp4", (368.0, 58.0, 158.0, 374.0)
FRAMES = 200
FASTER_GOAL, MEMORY_GOAL, BOX_GOAL = 3.0, 300e6, 1.0


def main() -> None:
    """Write the networks, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--keep", type=Path, help="folder to keep the .onnx files in")
    arguments = parser.parse_args()
    from re3.evaluation.environment import Environment

    here = Environment.here()
    print(f"{here.cpu}, {here.cores} cores, load {here.load:.1f} before; {here.date}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        plain, small = folder / "re3-fp32.onnx", folder / "re3-int8.onnx"
        write(plain, small)
        print_speed(plain, small, arguments.rounds)
        print_memory(small)
        print_boxes(plain, small)


def write(plain: Path, small: Path) -> None:
    """The same network in fp32 and with 8-bit weights; ranges of its maps are seen on every tenth
    of the frames that boxes are compared on."""
    from re3.benchmark.contenders import Entry
    from re3.evaluation.still_steps import still_steps
    from re3.network.export import export_onnx
    from re3.network.quantize_products import quantize_products
    from re3.network.quantize_trunk import quantize_trunk
    from re3.network.untrained import build_untrained

    network = build_untrained("re3")
    steps = [
        step
        for footage in footages()
        for step in still_steps(network.spec(), footage.frames[::10], footage.box_xywh)
    ]
    export_onnx(network, plain, half_weights=False)
    export_onnx(
        network,
        small,
        half_weights=False,
        change=lambda model: quantize_trunk(quantize_products(model), steps),
        weights_apart=True,
    )
    for path in (plain, small):
        size = Entry(path.stem, True, str(path)).size_bytes
        print(f"{path.name}: {size / 1e6:.1f} MB")


def footages() -> list[Footage]:
    """Made frames, and the bundled clip."""
    from re3.benchmark.footage import made_footage, read_footage

    return [made_footage(FRAMES + 1), read_footage(str(CLIP), CLIP_BOX, FRAMES + 1, None)]


def print_speed(plain: Path, small: Path, rounds: int) -> None:
    """The step alone, in turns."""
    from re3.benchmark.contenders import Entry
    from re3.benchmark.footage import made_footage
    from re3.benchmark.measure import over_rounds, take_turns
    from re3.cores import usable_cores

    cores = usable_cores()  # for all alike

    entries = [
        Entry("torch, eager, fp32", True, str(plain), "torch", threads=cores),
        Entry("ONNX Runtime, fp32", True, str(plain), "onnx", threads=cores),
        Entry("ONNX Runtime, 8-bit weights", True, str(small), "onnx", threads=cores),
    ]
    made = {entry.name: entry.make() for entry in entries}
    timings = take_turns(made, made_footage(40), rounds=rounds, frames=15)
    eager = timings[entries[0].name].network
    for name, timing in timings.items():
        step = over_rounds(timing.network)
        ratio = float(np.median(np.median(eager, axis=1) / np.median(timing.network, axis=1)))
        print(
            f"{name:28} step {1000 * step.p50:6.1f} ms (95 %: {1000 * step.p95:.1f}), "
            f"{ratio:.2f} times as fast as eager"
        )
    print(f"goal: {FASTER_GOAL:g} times as fast: {'met' if ratio >= FASTER_GOAL else 'NOT met'}")


def print_memory(small: Path) -> None:
    """Of a process of its own."""
    command = [sys.executable, ROOT / "benchmarks" / "footprint.py", "--child", "start"]
    done = subprocess.run(
        [*command, "--model", str(small)], check=True, stdout=subprocess.PIPE, text=True
    )
    told = json.loads(done.stdout)
    held, libraries, peak = (told[key] / 1e6 for key in ("resident", "libraries", "peak"))
    reached = "met" if held < MEMORY_GOAL / 1e6 else "NOT met"
    print(
        f"memory while tracking: {held:.0f} MB, of it Python and libraries {libraries:.0f}; "
        f"{peak:.0f} MB at most while loading (goal {MEMORY_GOAL / 1e6:.0f} MB: {reached})"
    )


def print_boxes(plain: Path, small: Path) -> None:
    """Largest and mean difference of a box's side over the frames."""
    for footage in footages():
        differences, moved = compare(plain, small, footage.frames, footage.box_xywh)
        width, height = footage.box_xywh[2:]
        print(
            f"{footage.name}, object of {width:.0f} x {height:.0f} pixels, {len(differences)} "
            f"frames: sides differ by {differences.max():.3f} pixels at most, "
            f"{differences.mean():.3f} in the mean (boxes move by {moved:.1f}; goal "
            f"{BOX_GOAL:g}: {'met' if differences.max() <= BOX_GOAL else 'NOT met'})"
        )


def compare(
    plain: Path, small: Path, frames: Sequence[np.ndarray], box_xywh: tuple[float, ...]
) -> tuple[np.ndarray, float]:
    """Per frame the largest difference of two networks' box sides in pixels, and how much boxes
    move (standard deviation over frames, mean of the sides).

    Frames are walked to and fro, crops are cut about the first box throughout.
    """
    from re3 import geometry
    from re3.engine import load_engine, zero_state

    engines = [load_engine(str(path), "onnx") for path in (plain, small)]
    spec = engines[0].spec
    assert spec.previous is not None, "the paper's network sees the frame before"
    box = geometry.convert(box_xywh, "xywh", "xyxy")
    region = geometry.search_region(box, spec.current.context)
    crops = [geometry.crop(frame, region, spec.current.size, spec.fill)[None] for frame in frames]
    order = [*range(len(crops)), *range(len(crops) - 2, -1, -1)]
    states = [zero_state(spec, 1)] * 2
    firsts = states
    found = []
    for step in range(FRAMES + 1):
        before, now = (order[max(0, s) % len(order)] for s in (step - 1, step))
        outputs = [
            engine.step(crops[before], crops[now], state)
            for engine, state in zip(engines, states, strict=True)
        ]
        states = [output.state for output in outputs]
        if step == 0:
            firsts = states
        elif step % spec.reset_interval == 0:
            states = firsts
        if step:
            found.append([geometry.decode(output.corners[0], region) for output in outputs])
    boxes = np.array(found)  # [frames, 2, 4]
    return np.abs(boxes[:, 0] - boxes[:, 1]).max(axis=1), float(boxes[:, 0].std(axis=0).mean())


if __name__ == "__main__":
    # Run from a checkout that is not installed as well.
    sys.path.insert(0, str(ROOT / "src"))
    main()
