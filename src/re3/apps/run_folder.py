"""What a training run was made of, written into its folder whenever it starts."""

from __future__ import annotations

import json
import platform
import re
import shlex
import subprocess
import sys
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import re3
from re3.evaluation.environment import Environment
from re3.evaluation.result_files import write_whole
from re3.training.packed.recipe import PackedRecipe
from re3.training.recipe import Recipe
from re3.training.recipe_file import recipe_yaml

RECIPE, STARTS, PACKAGES = "recipe.yaml", "run.json", "packages.txt"


def note_start(
    folder: Path,
    recipe: Recipe | PackedRecipe,
    iteration: int,
    device: str = "cpu",
    processes: int = 1,
) -> None:
    """Note a start of a run: the first one, or another that resumes it.

    `recipe.yaml` is the exact recipe, for `re3 train --recipe`; `packages.txt` all packages
    installed, with versions; `run.json` has an entry for each start: command line, revision of the
    code, machine, date, main versions, the recipe, and the iteration that it started from.

    Args:
        folder: of the run.
        recipe: as it is used, with all changes by options.
        iteration: how many are done.
        device: that is trained on, as the user named it.
        processes: that train together.
    """
    start = {
        "command": shlex.join(sys.orig_argv),
        "iteration": iteration,
        "device": device,
        "processes": processes,
        "revision": code_revision(),
        **asdict(Environment.here()),
        "machine": platform.node(),
        "recipe": asdict(recipe),
    }
    starts = [*read_starts(folder), start]
    write_whole(folder / STARTS, json.dumps({"starts": starts}, indent=2) + "\n")
    write_whole(folder / RECIPE, recipe_yaml(recipe))
    write_whole(folder / PACKAGES, "".join(f"{line}\n" for line in installed_packages()))


def read_starts(folder: Path) -> list[dict[str, Any]]:
    """The starts of a run, in order; none before the first."""
    path = folder / STARTS
    if not path.exists():
        return []
    starts: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["starts"]
    return starts


def code_revision() -> dict[str, Any] | None:
    """The git commit of re3's source and whether files differ from it; None outside of git."""
    package = Path(re3.__file__).parent
    # A package installed somewhere below a repository of the user's is not part of it.
    if _git(package, "ls-files", "--error-unmatch", "__init__.py") is None:
        return None
    commit, changes = _git(package, "rev-parse", "HEAD"), _git(package, "status", "--porcelain")
    return {"commit": (commit or "").strip(), "changed": bool(changes and changes.strip())}


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=20
        )
    except (OSError, subprocess.TimeoutExpired):
        return None  # no git here
    return done.stdout if done.returncode == 0 else None


def installed_packages() -> list[str]:
    """`name==version` of every package that this Python has, sorted."""
    found: dict[str, str] = {}
    for distribution in metadata.distributions():
        name = distribution.metadata["Name"]
        if name:
            key = re.sub(r"[-_.]+", "-", name).lower()
            found.setdefault(key, f"{key}=={distribution.version}")  # the first one is imported
    return sorted(found.values())
