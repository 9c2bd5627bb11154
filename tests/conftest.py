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


REASONS = (
    "needs the real clips",
    "needs the files of",
    "needs torchvision's AlexNet",
    "compares with NanoTrack",
    "takes no options",
    "ONNX Runtime's C++ headers",
)
"""Reasons for which a test may be skipped where `RE3_NO_SKIPS` is set: data and weights that are no
part of the repository, and headers that no package brings."""


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run with `RE3_NO_SKIPS` in which a test was skipped for a part that can be had."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not os.environ.get("RE3_NO_SKIPS") or reporter is None or session.exitstatus != 0:
        return
    for report in reporter.stats.get("skipped", []):
        reason = str(report.longrepr[-1]) if isinstance(report.longrepr, tuple) else ""
        if not any(known in reason for known in REASONS):
            reporter.write_line(f"{report.nodeid} was skipped with RE3_NO_SKIPS set: {reason}")
            session.exitstatus = 1
