"""Names of objects and titles of sessions: what can be shown and written to files."""

from __future__ import annotations

import unicodedata

LONGEST = 80
"""Characters of a name."""

BLANK = frozenset("\u115f\u1160\u2800\u3164\uffa0")
"""Letters and symbols that are drawn as nothing."""

_REVERSING = frozenset("\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
_JOINERS = frozenset("\u200c\u200d")  # part of words in Persian and of emoji


def checked_name(name: str) -> str:
    """A name as it is kept: spaces and line ends made one space each.

    Raises:
        ValueError: nothing visible in it, or characters that are not text: control characters such
            as NUL, those that change the direction of writing, invisible ones, half of a pair of
            surrogates.
    """
    name = unicodedata.normalize("NFC", " ".join(name.split()))
    for character in name:
        if not _is_text(character):
            told = unicodedata.name(character, "a control character")
            raise ValueError(
                f"the name holds U+{ord(character):04X} ({told.lower()}), which cannot be seen; "
                "leave it out"
            )
    if not any(_is_visible(character) for character in name):
        raise ValueError("the name is empty; expected at least one visible character")
    if len(name) > LONGEST:
        raise ValueError(f"the name has {len(name)} characters; expected {LONGEST} at most")
    return name


def cleaned_title(name: str) -> str:
    """A file's name as a title: without folders and without what cannot be shown."""
    last = name.replace("\\", "/").rsplit("/", 1)[-1]
    kept = "".join(character for character in last if _is_text(character)).strip()
    return kept if any(map(_is_visible, kept)) else "video"


def _is_text(character: str) -> bool:
    if character in _REVERSING:
        return False
    category = unicodedata.category(character)
    return category not in ("Cc", "Cf", "Cs", "Cn", "Zl", "Zp") or character in _JOINERS


def _is_visible(character: str) -> bool:
    return unicodedata.category(character)[0] not in "CMZ" and character not in BLANK
