"""Build the documentation into site/, and fail at any warning: what `make docs` runs.

    python tools/build_docs.py

Zensical's strict mode stops at links, anchors and snippets that lead nowhere. It passes over what
is checked here besides: docstrings that do not parse, pages that the navigation names and that
are missing, and pages that the navigation does not name.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
COMPLAINT = re.compile(r"^(griffe|mkdocstrings|mkdocs_autorefs|warning|error)\b", re.IGNORECASE)
"""How a line begins that tells of something wrong."""


def main() -> int:
    """Build; 1 where anything is wrong."""
    project = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]
    wrong = navigation_gaps(project["nav"], ROOT / project["docs_dir"])
    command = [sys.executable, "-m", "zensical", "build", "--clean", "--strict"]
    done = subprocess.run(
        command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    print(done.stdout, end="")
    wrong += complaints(done.stdout)
    if done.returncode:
        wrong.append(f"zensical ended with {done.returncode}")
    for each in wrong:
        print(f"wrong: {each}")
    if not wrong:
        print(f"{ROOT / project['site_dir'] / 'index.html'}: no warnings")
    return 1 if wrong else 0


def navigation_gaps(navigation: list[Any], folder: Path) -> list[str]:
    """Pages that are in the navigation or in the folder, but not in both."""
    named = set(pages_of(navigation))
    there = {str(page.relative_to(folder)) for page in folder.rglob("*.md")}
    return [f"{page} is in the navigation and does not exist" for page in sorted(named - there)] + [
        f"{page} is not in the navigation of zensical.toml" for page in sorted(there - named)
    ]


def pages_of(navigation: list[Any]) -> Iterator[str]:
    """All pages that a navigation names."""
    for entry in navigation:
        for target in entry.values():
            if isinstance(target, str):
                yield target
            else:
                yield from pages_of(target)


def complaints(output: str) -> list[str]:
    """Lines of a build's output that are warnings."""
    lines = COLOURS.sub("", output).splitlines()
    return [line.strip() for line in lines if COMPLAINT.match(line.strip())]


if __name__ == "__main__":
    sys.exit(main())
