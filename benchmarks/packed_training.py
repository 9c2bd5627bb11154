"""Crop pairs a second that training from packed data learns from, where the time goes, and how far
that is from what the device could do.

    python benchmarks/packed_training.py PACKED --device cuda --compile --cuda-graph

The floor is what a device needs that moves `BYTES_PER_PAIR` at the speed of a large copy and does
`OPERATIONS_PER_PAIR` at that of a large matrix product, both measured here, whichever is slower.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from re3.data.packed.shards import read_shards
from re3.data.sampling_config import SamplingConfig
from re3.network.variants import build
from re3.training.packed.bank import fill_bank
from re3.training.packed.draw import ClipDrawer
from re3.training.packed.index import index_shards
from re3.training.packed.recipe import GPU, Stage
from re3.training.packed.rollout import Renderer, search_region
from re3.training.packed.trainer import Limit, PackedTrainer
from re3.training.recipe_file import with_values

BYTES_PER_PAIR = 60e6
"""Activations of re3-lite at 192 pixels that a step writes and reads, forward and backward."""
OPERATIONS_PER_PAIR = 2e9
"""Floating-point operations of the same."""
ROUNDS = 5


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("packed", type=Path, help="folder of shards")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--unroll", type=int, default=8)
    parser.add_argument("--iterations", type=int, default=40)
    parser.add_argument("--workers", type=int, default=8)
    parser.add_argument("--compile", action="store_true")
    parser.add_argument("--cuda-graph", action="store_true")
    options = parser.parse_args()
    device = torch.device(options.device)
    shards = read_shards(options.packed)
    config = with_values(SamplingConfig(), shards[0].index.sampling)
    index = index_shards(shards, config.smallest)
    with ThreadPoolExecutor(8) as pool:
        begun = time.perf_counter()
        bank = fill_bank(index.image_sizes, index.pictures(pool), device)
        wait(device)
    print(f"pictures: {bank.gigabytes():.1f} GB in {time.perf_counter() - begun:.1f} s")
    drawer, renderer = ClipDrawer(index, config), Renderer(bank, config.fill[0], options.compile)
    clips = drawer.draw(options.batch, options.unroll + 1, np.random.default_rng(0))
    drawn = timed(lambda: _draw(drawer, options), device)
    print(f"clips drawn by one process: {drawn:.1f} ms a batch")
    clips = clips.to(device)
    generator = torch.Generator(device=device)
    regions = search_region(clips.boxes_xyxy[0], 3.0)
    crops = timed(lambda: renderer.crops(clips, 0, regions, 192, generator), device)
    print(f"crops: {crops:.1f} ms for {options.batch}")

    recipe = replace(GPU, stages=(Stage(1.0, options.unroll, options.batch, 0.6),))
    with tempfile.TemporaryDirectory() as folder:
        trainer = PackedTrainer(
            build("re3-lite"),
            drawer,
            renderer,
            recipe,
            folder,
            Limit(iterations=options.iterations),
            device,
            mixed=device.type == "cuda",
            compiled=options.compile,
            recorded=options.cuda_graph,
            workers=options.workers,
        )
        speeds: list[float] = []
        trainer.train(lambda progress: speeds.append(progress.pairs_per_second), 1e9)
    speed = statistics.median(speeds[2:] or speeds)
    floor = max(BYTES_PER_PAIR / bandwidth(device), OPERATIONS_PER_PAIR / operations(device))
    print(f"training: {speed:.0f} pairs/s, batches of {options.batch} at unroll {options.unroll}")
    if device.type == "cuda":
        print(f"memory: {torch.cuda.max_memory_allocated() / 1e9:.1f} GB")
    print(f"floor of this device: {1 / floor:.0f} pairs/s, {1 / floor / speed:.1f} times as many")


def _draw(drawer: ClipDrawer, options: argparse.Namespace) -> None:
    drawer.draw(options.batch, options.unroll + 1, np.random.default_rng(1))


def timed(work: Callable[[], object], device: torch.device) -> float:
    """Median milliseconds of some work."""
    work()
    found = []
    for _ in range(ROUNDS):
        wait(device)
        begun = time.perf_counter()
        work()
        wait(device)
        found.append(time.perf_counter() - begun)
    return statistics.median(found) * 1e3


def wait(device: torch.device) -> None:
    """Until the device has done all that it was given."""
    if device.type == "cuda":
        torch.cuda.synchronize()


def bandwidth(device: torch.device) -> float:
    """Bytes a second that a large copy reads and writes."""
    values = torch.rand(1 << (28 if device.type == "cuda" else 24), device=device)
    other = torch.empty_like(values)
    seconds = timed(lambda: other.copy_(values), device) / 1e3
    return 2 * values.numel() * values.element_size() / seconds


def operations(device: torch.device) -> float:
    """Floating-point operations a second of a large matrix product, in bfloat16 on a GPU."""
    side, kind = (8192, torch.bfloat16) if device.type == "cuda" else (1024, torch.float32)
    one = torch.rand(side, side, device=device).to(kind)
    other = torch.rand(side, side, device=device).to(kind)
    return 2 * side**3 / (timed(lambda: one @ other, device) / 1e3)


if __name__ == "__main__":
    main()
