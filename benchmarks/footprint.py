"""What re3 costs before and besides tracking: import, first box, memory, growth.

    python benchmarks/footprint.py                   # 100,000 frames: a quarter of an hour
    python benchmarks/footprint.py --frames 5000

Each figure is of fresh processes, whose files the system has read before (the first start after
switching a machine on takes longer). Frames are made, 640 x 480, one object.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
from pathlib import Path

IMPORT_GOAL, FIRST_BOX_GOAL = 0.3, 0.5
"""Seconds."""
MEMORY_GOAL = 250e6
"""Bytes."""

STARTS = 7
SHARES = (0.01, 0.1, 0.25, 0.5, 0.75, 1.0)
"""Shares of the run after which memory is looked at."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", default="re3-lite")
    parser.add_argument("--frames", type=int, default=100_000)
    parser.add_argument("--child", choices=["start", "grow"], help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child == "start":
        print(json.dumps(start(arguments.model)))
    elif arguments.child == "grow":
        grow(arguments.model, arguments.frames)
    else:
        report(arguments.model, arguments.frames)


def report(model: str, frames: int) -> None:
    """Start processes and print what they tell."""
    from re3.evaluation.environment import Environment

    here = Environment.here()
    print(f"{here.cpu}, {here.cores} cores, load {here.load:.1f} before; {here.date}")
    starts = [json.loads(child("start", model, frames)) for _ in range(STARTS)]
    starts.sort(key=lambda one: one["import"])
    print(f"median of {STARTS} starts, {model}:")
    for what, key, goal in (
        ("import re3", "import", IMPORT_GOAL),
        ("from there to the first box, loading the model", "first_box", FIRST_BOX_GOAL),
    ):
        value = sorted(one[key] for one in starts)[STARTS // 2]
        print(f"  {what}: {value:.3f} s (goal {goal} s: {met(value < goal)})")
    value = sorted(one["resident"] for one in starts)[STARTS // 2]
    libraries = sorted(one["libraries"] for one in starts)[STARTS // 2]
    print(
        f"  memory while tracking: {value / 1e6:.0f} MB, of it Python and libraries "
        f"{libraries / 1e6:.0f} MB (goal {MEMORY_GOAL / 1e6:.0f} MB: {met(value < MEMORY_GOAL)})"
    )
    print("what importing costs, the slowest first (python -X importtime -c 'import re3'):")
    for seconds, name in import_times()[:8]:
        print(f"  {1000 * seconds:6.1f} ms  {name}")
    print(f"memory over {frames} frames:")
    print(child("grow", model, frames), end="")


def met(reached: bool) -> str:
    """For people."""
    return "met" if reached else "NOT met"


def child(kind: str, model: str, frames: int) -> str:
    """What this program prints when it is started as a child."""
    command = [sys.executable, __file__, "--child", kind, "--model", model]
    return subprocess.run(
        [*command, "--frames", str(frames)], check=True, stdout=subprocess.PIPE, text=True
    ).stdout


def start(model: str) -> dict[str, float]:
    """Import, load, track: seconds and bytes of this process."""
    started = time.perf_counter()
    import re3

    imported = time.perf_counter()
    from re3.benchmark.footage import made_footage
    from re3.benchmark.resident import peak_bytes, resident_bytes

    libraries = resident_bytes()
    footage = made_footage(40)
    ready = time.perf_counter()
    tracker = re3.Tracker(model)
    tracker.init(footage.frames[0], footage.box_xywh)
    tracker.update(footage.frames[1])
    first_box = time.perf_counter()
    for frame in footage.frames[2:]:
        tracker.update(frame)
    return {
        "import": imported - started,
        "first_box": first_box - ready,
        "libraries": libraries,
        # Frames kept here are the caller's memory, not the tracker's.
        "resident": resident_bytes() - sum(frame.nbytes for frame in footage.frames),
        "peak": peak_bytes() - sum(frame.nbytes for frame in footage.frames),
    }


def grow(model: str, frames: int) -> None:
    """Track for long, round and round, and print memory and speed on the way."""
    import re3
    from re3.benchmark.footage import made_footage
    from re3.benchmark.resident import resident_bytes

    footage = made_footage(150)  # a lap: the last frame leads to the first
    tracker = re3.Tracker(model)
    tracker.init(footage.frames[0], footage.box_xywh)
    looks = [max(1, round(share * frames)) for share in SHARES]
    last, started = 0, time.perf_counter()
    for index in range(1, frames + 1):
        tracker.update(footage.frames[index % len(footage.frames)])
        if index in looks:
            now = time.perf_counter()
            rate = (index - last) / (now - started)
            held = resident_bytes() - sum(frame.nbytes for frame in footage.frames)
            print(f"  {index:7d}  {held / 1e6:6.1f} MB  {rate:5.0f} FPS", flush=True)
            last, started = index, now


def import_times() -> list[tuple[float, str]]:
    """Seconds that each module takes by itself, added up by package, the longest first."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", "import re3"],
        check=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    spent: dict[str, float] = {}
    for own, name in re.findall(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)", done.stderr):
        package = name.partition(".")[0]
        spent[package] = spent.get(package, 0.0) + int(own) / 1e6
    return sorted(((seconds, name) for name, seconds in spent.items()), reverse=True)


if __name__ == "__main__":
    # Run from a checkout that is not installed as well.
    sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
    main()
