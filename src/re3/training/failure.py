"""A batch that broke training, kept on disk so that it can be looked into."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import torch

from re3.network.base import TrackingNetwork
from re3.training.checkpoint import save_whole
from re3.training.recipe import Recipe
from re3.training.step import NotFinite


def failure_path(folder: Path, iteration: int, rank: int = 0) -> Path:
    """Where a process keeps the batch of an iteration that broke training."""
    return folder / f"failure-{iteration}{f'-process-{rank}' if rank else ''}.pt"


def save_failure(
    path: Path, error: NotFinite, network: TrackingNetwork, recipe: Recipe, iteration: int
) -> None:
    """Write all that is needed to see it happen again.

    `torch.load(path, weights_only=True)` gives a dictionary: the roll-out's `images` and, of a
    network that takes any, `previous_images` (uint8 BGR crops), `looked`, `targets`, `has_box`,
    `hidden` and `steps`; the predicted `corners`; the loss and its `parts`; the `network`'s weights
    as they were; `iteration` and `seed`, from which the batch was drawn, and the whole `recipe`.
    """
    rollout = error.rollout
    save_whole(
        {
            "what": str(error),
            "iteration": iteration,
            "seed": recipe.seed,
            "recipe": asdict(recipe),
            "loss": error.losses.value,
            "parts": error.losses.parts,
            "corners": error.corners,
            "images": torch.from_numpy(rollout.images),
            "previous_images": (
                None
                if rollout.previous_images is None
                else torch.from_numpy(rollout.previous_images)
            ),
            "looked": rollout.looked,
            "targets": rollout.targets,
            "has_box": rollout.has_box,
            "hidden": rollout.hidden,
            "steps": rollout.steps,
            "network": network.state_dict(),
        },
        path,
    )
