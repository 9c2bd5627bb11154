"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real clips: `$RE3_DATA`, or `shared/data` beside the repository.

    A test that asks for it is skipped where neither exists.
    """
    given = os.environ.get("RE3_DATA")
    folder = Path(given) if given else REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"needs the real clips: {folder} is not a folder; set RE3_DATA to theirs")
    return folder
