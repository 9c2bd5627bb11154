"""Names that can be seen and written."""

import pytest

from re3.apps.server.names import checked_name, cleaned_title


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("  the \n table ", "the table"),
        ("Hund", "Hund"),
        ("e\u0301", "é"),  # one letter in two characters
        ("\u0645\u06cc\u200c\u062e", "\u0645\u06cc\u200c\u062e"),  # a joiner within a Persian word
        ("👩\u200d🚀", "👩\u200d🚀"),
        ("=cmd", "=cmd"),
        ("12", "12"),
        ("♥", "♥"),
    ],
)
def test_names_that_are_kept(given, kept):
    assert checked_name(given) == kept


@pytest.mark.parametrize(
    "given",
    [
        "a\0b",
        "a\x1b[31m",
        "a\x7f",
        "a\u202eb",
        "\u200fa",
        "a\u2066b",
        "a\u061cb",
        "a\u200bb",
        "a\ufeff",
        "a\u2060b",
        "a\u00adb",
        "a\ud800",
        "a\uffff",
        "a\u200e",
    ],
)
def test_names_with_what_cannot_be_seen(given):
    with pytest.raises(ValueError, match=r"holds U\+[0-9A-F]{4}.*leave it out"):
        checked_name(given)


@pytest.mark.parametrize(
    "given", ["", " ", "\n\t", "\u200d", "\u200c\u200c", "\u3164", "\u2800", "\u0301"]
)
def test_names_with_nothing_to_see(given):
    with pytest.raises(ValueError, match="the name is empty"):
        checked_name(given)


def test_long_names():
    with pytest.raises(ValueError, match="has 81 characters; expected 80"):
        checked_name("a" * 81)


@pytest.mark.parametrize(
    ("given", "title"),
    [
        ("../../a/b.mp4", "b.mp4"),
        ("C:\\videos\\b.mp4", "b.mp4"),
        ("a\0b\u202e\u200bc.mp4", "abc.mp4"),
        ("\u200b\u202e", "video"),
        ("\u200d", "video"),
        ("", "video"),
    ],
)
def test_titles_are_cleaned(given, title):
    assert cleaned_title(given) == title
