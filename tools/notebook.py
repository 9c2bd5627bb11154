"""Run the quickstart notebook and keep what it shows: a web page shows a notebook as it is kept.

    python tools/notebook.py

Needs the extra "dev". Run it again when the tracker finds other boxes.
"""

from __future__ import annotations

from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

NOTEBOOK = Path(__file__).parents[1] / "examples" / "quickstart.ipynb"


def main() -> None:
    """Run it and write it back."""
    notebook = run(nbformat.read(NOTEBOOK, as_version=4))
    for cell in notebook.cells:
        # Times of the run, which would change the file every time.
        cell.metadata.pop("execution", None)
    notebook.metadata = NotebookNode(kernelspec=notebook.metadata["kernelspec"])
    nbformat.write(notebook, NOTEBOOK)
    print(f"{NOTEBOOK}: {NOTEBOOK.stat().st_size / 1000:.0f} kB")


def run(notebook: NotebookNode) -> NotebookNode:
    """The notebook with the outputs of a fresh run, in its own folder.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell raises.
    """
    place = {"metadata": {"path": str(NOTEBOOK.parent)}}
    return NotebookClient(
        notebook, timeout=120, startup_timeout=120, kernel_name="python3", resources=place
    ).execute()


if __name__ == "__main__":
    main()
