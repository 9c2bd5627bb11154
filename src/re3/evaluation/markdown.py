"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence as Several


def markdown_table(header: Iterable[str], rows: Several[Several[str]], left: int = 1) -> list[str]:
    """The lines of a table.

    Args:
        header: of each column.
        rows: of texts, each as long as the header.
        left: columns that are set to the left; the others are set to the right.
    """
    first, *others = ([text.replace("|", "\\|") for text in row] for row in (header, *rows))
    marks = ["---" if index < left else "---:" for index in range(len(first))]
    return ["| " + " | ".join(row) + " |" for row in (first, marks, *others)]
