"""Tables and names in Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable
from collections.abc import Sequence as Several

_MARKUP = re.compile(r"[\\`*\[\]|~]|<(?=[A-Za-z/!?])|&(?=#?\w+;)|(?<![^\W_])_|_(?![^\W_])")
"""What Markdown, or HTML in it, would take for markup; an underscore within a word it does not."""


def markdown_text(text: str) -> str:
    """Text of unknown origin, such as a file's name, as Markdown that shows it as it is."""
    return _MARKUP.sub(r"\\\g<0>", " ".join(text.split()))


def markdown_code(text: str) -> str:
    """The same as a span of code."""
    text = " ".join(text.split())
    fence = "`" * (max(map(len, re.findall("`+", text)), default=0) + 1)
    space = " " if "`" in text else ""
    return f"{fence}{space}{text}{space}{fence}"


def markdown_table(header: Iterable[str], rows: Several[Several[str]], left: int = 1) -> list[str]:
    """The lines of a table.

    Args:
        header: of each column.
        rows: of texts, each as long as the header.
        left: columns that are set to the left; the others are set to the right.
    """
    first, *others = ([markdown_text(text) for text in row] for row in (header, *rows))
    marks = ["---" if index < left else "---:" for index in range(len(first))]
    return ["| " + " | ".join(row) + " |" for row in (first, marks, *others)]
