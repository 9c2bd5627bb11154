"""`re3 track` on a 1080p clip: how much longer the whole takes than its slowest stage alone.

    python benchmarks/whole_video.py
    python benchmarks/whole_video.py --frames 600 --model re3-lite

Makes the clip (an object that goes round, H.264), then times decoding, tracking and encoding each
alone, one after the other, and the whole as `re3 track --out` runs it. In no less than the slowest
stage's time can the whole be done, nor in less than all the stages' work divided by the cores.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

SIZE = (1920, 1080)
GOAL = 1.15
"""The whole may take so many times as long as the slowest stage."""


@dataclass(frozen=True)
class Spent:
    """Seconds by the clock, and of processor time in all threads."""

    clock: float
    work: float


def main() -> None:
    """Make the clip, measure in turns and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", default="re3-lite")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    from re3.benchmark.footage import made_footage
    from re3.evaluation.environment import Environment
    from re3.video import VideoWriter

    here = Environment.here()
    print(f"{here.cpu}, {here.cores} cores, load {here.load:.1f} before; {here.date}")
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        footage = made_footage(arguments.frames, SIZE)
        with VideoWriter(clip, 30, SIZE) as writer:
            for frame in footage.frames:
                writer.write(frame)
        box = footage.box_xywh
        del footage  # gigabytes
        stages = {
            "decode": lambda: decode(clip),
            "track": lambda: track(clip, arguments.model, box),
            "encode": lambda: encode(clip, Path(folder) / "again.mp4"),
            "one after the other": lambda: whole(clip, arguments.model, box, Path(folder), False),
            "whole": lambda: whole(clip, arguments.model, box, Path(folder), True),
        }
        rounds: dict[str, list[Spent]] = {name: [] for name in stages}
        for _ in range(arguments.rounds):
            for name, stage in stages.items():
                rounds[name].append(stage())
    clock = {name: statistics.median(one.clock for one in each) for name, each in rounds.items()}
    work = {name: statistics.median(one.work for one in each) for name, each in rounds.items()}
    frames = arguments.frames
    print(f"{frames} frames of {SIZE[0]} x {SIZE[1]}, medians of {arguments.rounds} rounds")
    for name in stages:
        print(
            f"  {name:20} {1000 * clock[name] / frames:6.2f} ms a frame "
            f"({frames / clock[name]:5.0f} FPS), processor {1000 * work[name] / frames:6.2f} ms"
        )
    alone = ("decode", "track", "encode")
    slowest = max(alone, key=lambda name: clock[name])
    ratio = clock["whole"] / clock[slowest]
    print(f"the whole takes {ratio:.2f} times as long as the slowest stage, {slowest}", end="")
    print(f" (goal {GOAL}: {'met' if ratio <= GOAL else 'NOT met'})")
    least = max(clock[slowest], sum(work[name] for name in alone) / here.cores)
    print(
        f"with {here.cores} cores it cannot take less than {1000 * least / frames:.2f} ms a frame; "
        f"it takes {clock['whole'] / least:.2f} times that"
    )


def timed(run: Callable[[], object]) -> Spent:
    """What a run takes."""
    clock, work = time.perf_counter(), time.process_time()
    run()
    return Spent(time.perf_counter() - clock, time.process_time() - work)


def decode(clip: Path) -> Spent:
    """Read every frame."""
    from re3.video import open_source

    with open_source(clip) as source:
        return timed(lambda: [None for _ in source])


def track(clip: Path, model: str, box: tuple[float, ...]) -> Spent:
    """Follow the object; reading is not counted."""
    from re3 import Tracker
    from re3.video import open_source

    tracker = Tracker(model)
    clock = work = 0.0
    with open_source(clip) as source:
        for frame in source:
            if frame.index == 0:
                tracker.init(frame.image, box)
            else:
                spent = timed(lambda image=frame.image: tracker.update(image))  # type: ignore[misc]
                clock, work = clock + spent.clock, work + spent.work
    return Spent(clock, work)


def encode(clip: Path, out: Path) -> Spent:
    """Write frames held in memory, over and over; drawing is not counted."""
    from itertools import islice

    from re3.video import VideoWriter, open_source

    with open_source(clip) as source:
        count = source.frame_count or 1
        images = [frame.image for frame in islice(source, 60)]

    def run() -> None:
        with VideoWriter(out, 30, SIZE) as writer:
            for index in range(count):
                writer.write(images[index % len(images)])

    return timed(run)


def whole(clip: Path, model: str, box: tuple[float, ...], folder: Path, overlap: bool) -> Spent:
    """Read, follow, draw and write, as `re3 track` does, or without its threads."""
    from re3 import MultiTracker
    from re3.apps.tracking import track_video
    from re3.video import VideoWriter, draw_results, open_source

    tracker = MultiTracker(model)

    def run() -> None:
        with open_source(clip) as source, VideoWriter(folder / "out.mp4", 30, SIZE) as video:
            if overlap:
                track_video(source, tracker, {"object": box}, video)
                return
            for frame in source:
                if frame.index == 0:
                    tracker.add(frame.image, box)
                found = tracker.results if frame.index == 0 else tracker.update(frame.image)
                video.write(draw_results(frame.image, found.values()))

    return timed(run)


if __name__ == "__main__":
    # Run from a checkout that is not installed as well.
    sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
    main()
