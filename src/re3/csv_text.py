"""Names in CSV files that spreadsheets do not take for formulas."""

from __future__ import annotations

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a cell begins with that Excel, LibreOffice or Sheets compute instead of showing it."""


def csv_text(name: str) -> str:
    """A name as text for a CSV file: with an apostrophe before it where it begins like a formula.

    Names come from users, files and pages; a spreadsheet would run `=cmd|...`. Numbers are written
    without this function.
    """
    return f"'{name}" if name.startswith(_FORMULA) else name
