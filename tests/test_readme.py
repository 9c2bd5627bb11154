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


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands(program):
    lines = [line for block in blocks("sh") for line in block.splitlines()]
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


@pytest.mark.parametrize("command", commands("re3"), ids=" ".join)
def test_the_commands_have_these_options(command):
    found = get_command(app).commands[command[1]]
    options = {option for parameter in found.params for option in parameter.opts}
    used = {word for word in command[2:] if re.fullmatch(r"--?[a-z-]+", word) and word != "-"}
    assert used <= options


def test_the_make_commands_exist():
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    used = [command[1] for command in commands("make")]
    assert used == ["demo", "test"]
    assert set(used) <= set(targets)


def test_the_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target


def test_no_figure_is_left_out():
    assert not re.findall(r"@[A-Z]+@", README)
