"""A network, data and recipe small enough to train in a test, also as a program.

    python tiny.py FOLDER

trains in a folder, with a checkpoint after each iteration; under torchrun the processes share the
batches.
"""

import sys

import numpy as np
import torch

from re3.data.clip import RecordedClip
from re3.model_spec import CropSpec
from re3.network.lite_config import LiteConfig
from re3.network.re3_lite import Re3Lite
from re3.training.distributed import join_processes, leave_processes
from re3.training.recipe import Phase, PlateauRule, Recipe
from re3.training.trainer import Trainer

SMALL = LiteConfig(
    current=CropSpec(context=3.0, size=96),
    fully_connected=16,
    lstm_units=8,
    fused=8,
    embedding=8,
    correlation=4,
)
CURRICULUM = Recipe(
    # The loss does not halve within an iteration: both of the first phases end at the second.
    phases=(Phase(2, 4, 0.0, 4), Phase(3, 4, 0.5, 4), Phase(4, 4, 1.0, 2)),
    plateau=PlateauRule(window=1, improvement=0.5, patience=1),
    warm_up=1,
    average=0.5,
    learning_rate=3e-3,
)


class TinySampler:
    """Clips of a bright square that walks over noise."""

    sequences = ()
    stills = ()

    def sample(self, frames, rng):
        background = rng.integers(0, 100, (60, 80, 3), dtype=np.uint8)
        x, y = rng.uniform(10, 50), rng.uniform(10, 30)
        velocity = rng.normal(0, 2, 2)
        images, boxes = [], []
        for t in range(frames):
            left, top = (round(float(v)) for v in np.array([x, y]) + velocity * t)
            left, top = int(np.clip(left, 0, 64)), int(np.clip(top, 0, 44))
            image = background.copy()
            image[top : top + 16, left : left + 16] = 230
            images.append(image)
            boxes.append((left, top, left + 16, top + 16))
        return RecordedClip(images, boxes, (127.0,) * 3)


def small_network():
    torch.manual_seed(0)
    network = Re3Lite(SMALL).eval()
    with torch.no_grad():  # a box in the middle, or its own predictions would be put back at once
        network.head.residual.bias.copy_(torch.tensor([-5.0, -5.0, 5.0, 5.0]) / 3)
    return network


def train(folder, processes=None):
    """Train by the curriculum; the trainer."""
    given = {} if processes is None else {"processes": processes}
    trainer = Trainer(small_network(), TinySampler(), CURRICULUM, folder, threads=1, **given)
    trainer.train(checkpoint_seconds=0.0)
    return trainer


if __name__ == "__main__":
    together = join_processes()
    train(sys.argv[1], together)
    leave_processes(together)
