"""What the README shows works."""

import re
import shlex
from pathlib import Path

import pytest
from typer.main import get_command

import re3
from re3.apps.cli import app
from re3.video import open_source

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language, text=README):
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def commands(program, text=README):
    lines = [line for block in blocks("sh", text) for line in block.splitlines()]
    words = [shlex.split(line, comments=True) for line in lines]
    return [each for each in words if each and each[0] == program]


def test_the_python_example_runs():
    with open_source(ROOT / "examples" / "clips" / "person.mp4") as source:
        first, second = (frame.image for frame, _ in zip(source, range(2), strict=False))
    x, y, w, h = 368, 58, 158, 374
    names = {"frame_bgr": first, "next_frame": second, "x": x, "y": y, "w": w, "h": h}
    (code,) = blocks("python")
    exec(compile(code, "README.md", "exec"), names)
    assert isinstance(names["result"], re3.Result)
    assert names["results"][names["car"]].name == "car"


def found_command(words):
    """The command that a line calls, through the apps inside the app, and the words after it."""
    found, rest = get_command(app), words[1:]
    while hasattr(found, "commands"):
        found, rest = found.commands[rest[0]], rest[1:]
    return found, rest


@pytest.mark.parametrize("command", commands("re3"), ids=" ".join)
def test_the_commands_have_these_options(command):
    found, rest = found_command(command)
    options = {
        o for parameter in found.params for o in (*parameter.opts, *parameter.secondary_opts)
    }
    used = {word for word in rest if re.fullmatch(r"--?[a-z-]+", word) and word != "-"}
    assert used <= options


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_the_commands_of_the_docs_have_these_options(page):
    for command in commands("re3", page.read_text(encoding="utf-8")):
        test_the_commands_have_these_options(command)


def test_commands_inside_an_app_are_found():
    found, rest = found_command(["re3", "data", "check", "OTB100", "--frames"])
    assert (found.name, rest) == ("check", ["OTB100", "--frames"])


def test_the_make_commands_exist():
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    used = [command[1] for command in commands("make")]
    assert used == ["demo", "serve", "test"]
    assert set(used) <= set(targets)


def test_the_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target


def test_no_figure_is_left_out():
    assert not re.findall(r"@[A-Z]+@", README)
