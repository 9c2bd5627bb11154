"""What the README shows works; its commands are run in test_docs_commands.py."""

import re

import re3
from documents import README, ROOT, blocks, commands, make_targets, text_of
from re3.video import open_source

TEXT = text_of(README)


def test_the_python_example_runs():
    with open_source(ROOT / "examples" / "clips" / "person.mp4") as source:
        first, second = (frame.image for frame, _ in zip(source, range(2), strict=False))
    x, y, w, h = 368, 58, 158, 374
    names = {"frame_bgr": first, "next_frame": second, "x": x, "y": y, "w": w, "h": h}
    (code,) = blocks("python", TEXT)
    exec(compile(code, "README.md", "exec"), names)
    assert isinstance(names["result"], re3.Result)
    assert names["results"][names["car"]].name == "car"


def test_the_make_commands_do_all_the_set_up():
    used = [words[1] for words in commands(TEXT) if words[0] == "make"]
    assert used == ["demo", "serve", "test"]
    assert set(used) <= make_targets()


def test_the_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target


def test_no_figure_is_left_out():
    assert not re.findall(r"@[A-Z]+@", TEXT)
