"""Names in the order people expect: `img2` before `img10`."""

from __future__ import annotations

import re


def natural_key(text: str) -> tuple[tuple[int, str], ...]:
    """Sort key that puts `clip2` before `clip10`."""
    parts = re.split(r"([0-9]+)", text)
    # Digits compare as numbers, the text between them without regard to case.
    return tuple((int(p), "") if p.isdecimal() else (0, p.lower()) for p in parts)
