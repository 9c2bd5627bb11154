import subprocess
import sys

import pytest

pytest.importorskip("yaml", reason="training needs PyYAML (the train extra)")

import re3
from re3.apps.run_folder import (
    PACKAGES,
    RECIPE,
    code_revision,
    installed_packages,
    note_start,
    read_starts,
)
from re3.training.recipe import FROZEN_TRUNK, PAPER
from re3.training.recipe_file import read_recipe


def git(folder, *arguments):
    identity = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
    command = ["git", *identity, "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package in place of re3, in a new git repository that does not have it yet."""
    file = tmp_path / "code" / "re3" / "__init__.py"
    file.parent.mkdir(parents=True)
    file.write_text("")
    monkeypatch.setattr(re3, "__file__", str(file))
    git(tmp_path / "code", "init")
    return file


def test_each_start_is_noted(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "orig_argv", ["re3", "train", "--data", "my clips"])
    note_start(tmp_path, PAPER, 0, "cuda", 4)
    note_start(tmp_path, FROZEN_TRUNK, 120)
    first, second = read_starts(tmp_path)
    assert first["command"] == "re3 train --data 'my clips'"
    assert (first["device"], first["processes"], first["iteration"]) == ("cuda", 4, 0)
    assert (second["device"], second["processes"], second["iteration"]) == ("cpu", 1, 120)
    assert first["recipe"]["learning_rate"] == 1e-5
    assert first["versions"]["re3"] == re3.__version__
    assert first["cores"] >= 1
    assert read_recipe(tmp_path / RECIPE) == FROZEN_TRUNK  # the latest
    assert (tmp_path / PACKAGES).read_text().splitlines() == installed_packages()


def test_packages_have_versions():
    import numpy

    assert f"numpy=={numpy.__version__}" in installed_packages()


def test_the_revision_is_that_of_the_code(package):
    folder = package.parent
    assert code_revision() is None  # beside a repository, but not of it
    git(folder, "add", ".")
    git(folder, "commit", "-m", "first")
    commit = git(folder, "rev-parse", "HEAD")
    assert code_revision() == {"commit": commit, "changed": False}
    package.write_text("changed = True\n")
    assert code_revision() == {"commit": commit, "changed": True}


def test_without_git_there_is_no_revision(package, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert code_revision() is None
