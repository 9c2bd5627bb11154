"""The README and the pages of the documentation, and the commands and code that they show."""

import re
import shlex
from pathlib import Path

from typer.main import get_command

from re3.apps.cli import app

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def text_of(page):
    return page.read_text(encoding="utf-8")


def blocks(language, text):
    """The code blocks of a language; "" for those that name none."""
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)
    return [block for name, block in fences if name == language]


def commands(text):
    """The words of each line of the shell blocks, without comments."""
    lines = [
        line for block in blocks("sh", text) for line in block.replace("\\\n", " ").splitlines()
    ]
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def found_command(words):
    """The command that a line calls, through the apps inside the app, and the words after it."""
    found, rest = get_command(app), words[1:]
    while hasattr(found, "commands"):
        found, rest = found.commands[rest[0]], rest[1:]
    return found, rest


def unknown_options(words):
    """Options in a line that the command it calls does not have."""
    found, rest = found_command(words)
    known = {o for parameter in found.params for o in (*parameter.opts, *parameter.secondary_opts)}
    used = {word for word in rest if re.fullmatch(r"--?[a-z-]+", word) and word != "-"}
    return used - known - {"--help"}


def make_targets():
    return set(re.findall(r"^([a-z]+):", text_of(ROOT / "Makefile"), flags=re.MULTILINE))
