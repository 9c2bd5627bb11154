"""Every command and every piece of Python in the README and the documentation.

Commands on the bundled clip are run. All others need data that is not part of the repository, a
camera, or hours: they are parsed by the command line itself, which refuses what it does not know.
"""

import ast
import contextlib
import importlib
import io
import re
import subprocess
import sys
import tomllib
from itertools import zip_longest

import pytest
from typer.testing import CliRunner

from documents import (
    PAGES,
    README,
    ROOT,
    blocks,
    commands,
    found_command,
    make_targets,
    text_of,
    unknown_options,
)
from re3.apps.cli import app

ALONE = {"re3 models"}
"""Commands that need nothing at all."""

ELSEWHERE = {
    "g++": "tests/apps/test_export_command.py compiles the example where it can",
    "ffmpeg": "feeds that example",
}
"""Programs that are not ours -> why they are not called here."""

WRITTEN_BY_EXPORT = ROOT / "src" / "re3" / "exported"
"""Programs that `re3 export` puts beside its file; they are shown in the folder out."""

RUN_IN_FULL = {"index.md", "tour.md", "python.md", "api-evaluation.md"}
"""Pages whose Python needs nothing but the bundled clip."""

SHOWN = [(page, words) for page in PAGES for words in commands(text_of(page))]
INLINE = [
    (page, code.split())
    for page in PAGES
    for code in re.findall(r"(?<!`)`((?:re3|python|make) [^`]+)`(?!`)", text_of(page))
]


def runs(words):
    return any(word.startswith("examples/") for word in words) or " ".join(words) in ALONE


def shown_by(program, wanted=lambda words: True):
    return [
        pytest.param(words, id=f"{page.name}: {' '.join(words)}"[:100])
        for page, words in SHOWN
        if words[0] == program and wanted(words)
    ]


@pytest.fixture
def sandbox(tmp_path, monkeypatch):
    """An empty folder with the examples in it, as a fresh clone has them."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_nothing_else_is_called():
    assert {words[0] for _, words in SHOWN} <= {"re3", "make", "pip", "python", *ELSEWHERE}


@pytest.mark.parametrize("words", [p for name in ("python", *ELSEWHERE) for p in shown_by(name)])
def test_programs_that_export_writes_exist(words):
    for word in words:
        if word.startswith("out/") and word.endswith((".py", ".cpp")):
            assert (WRITTEN_BY_EXPORT / word.removeprefix("out/")).is_file()


@pytest.mark.parametrize("words", shown_by("re3", runs))
def test_commands_on_the_bundled_clip_run(words, sandbox):
    done = CliRunner().invoke(app, words[1:])
    assert done.exit_code == 0, done.output
    written = [words[i + 1] for i, word in enumerate(words) if word in ("--out", "--results")]
    for name in written:
        assert name == "-" or (sandbox / name).stat().st_size > 0


@pytest.mark.parametrize("words", shown_by("re3", lambda words: not runs(words)))
def test_commands_that_need_data_are_understood(words):
    found, rest = found_command(words)
    found.make_context(found.name, list(rest))


def test_the_command_line_refuses_what_it_does_not_know():
    found, rest = found_command(["re3", "track", "clip.mp4", "--bix", "1,2,3,4"])
    with pytest.raises(Exception, match="No such option"):
        found.make_context(found.name, list(rest))


@pytest.mark.parametrize("words", shown_by("make"))
def test_make_has_the_targets(words):
    # `make demo` is examples/demo.py (tests/apps), `make test` is this, `make docs` test_docs.py.
    assert words[1] in make_targets()


@pytest.mark.parametrize("words", shown_by("pip"))
def test_pip_is_asked_for_extras_that_exist(words):
    # Not run: a test installs nothing.
    known = tomllib.loads(text_of(ROOT / "pyproject.toml"))["project"]["optional-dependencies"]
    assert words[1] == "install"
    for extras in re.findall(r"\[([a-z,]+)\]", " ".join(words)):
        assert set(extras.split(",")) <= set(known)


@pytest.mark.parametrize("words", shown_by("python", lambda words: not words[1].startswith("out/")))
def test_scripts_have_these_options(words):
    if words[1] == "examples/client.py":
        pytest.skip("takes no options; tests/apps/server/test_commands.py runs it")
    call = words[1:3] if words[1] == "-m" else words[1:2]
    done = subprocess.run(
        [sys.executable, *call, "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    for option in (word for word in words if word.startswith("--")):
        assert option in done.stdout


@pytest.mark.parametrize(
    ("page", "words"), [pytest.param(p, w, id=f"{p.name}: {' '.join(w)}"[:80]) for p, w in INLINE]
)
def test_commands_within_the_text_exist(page, words):
    if words[0] == "make":
        assert words[1] in make_targets()
    elif words[0] == "python":
        assert words[1] == "-m" or (ROOT / words[1]).is_file()
    elif not words[1].startswith("-") and words[1].islower():
        assert not unknown_options(words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_are_marked_as_such(page):
    """A block without a language holds output or a layout: commands there would not be tested."""
    for block in blocks("", text_of(page)):
        assert not re.search(r"^(re3|pip|python|make) (?!\d)", block, flags=re.MULTILINE)


def python_of(page):
    """Pieces of Python, each with the output that is shown right below it, or None."""
    fences = r"^```(\w*)\n(.*?)^```$\n*"
    found = list(re.finditer(fences, text_of(page), flags=re.DOTALL | re.MULTILINE))
    pieces = []
    for fence, after in zip_longest(found, found[1:]):
        if fence[1] == "python":
            below = after is not None and after.start() == fence.end() and not after[1]
            pieces.append((fence[2], after[2] if below else None))
    return pieces


@pytest.mark.parametrize("page", [p for p in PAGES if p.name in RUN_IN_FULL], ids=lambda p: p.name)
def test_python_runs_and_prints_what_is_shown(page, sandbox):
    if "supervision" in text_of(page):
        pytest.importorskip("supervision", reason="this page shows it")
    names = {}
    for code, shown in python_of(page):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, page.name, "exec"), names)
        if shown:
            same_but_for_rounding(printed.getvalue(), shown)


def same_but_for_rounding(printed, shown):
    """Words are equal, numbers nearly: other processors round otherwise."""
    number = r"-?\d+\.\d+"
    assert re.sub(number, "#", printed) == re.sub(number, "#", shown)
    found, expected = ([float(n) for n in re.findall(number, text)] for text in (printed, shown))
    assert found == pytest.approx(expected, rel=0.1, abs=3)


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if p.name not in RUN_IN_FULL and p != README and python_of(p)],
    ids=lambda p: p.name,
)
def test_python_that_needs_data_imports_what_exists(page):
    for code, _ in python_of(page):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(node.module)
                assert all(hasattr(module, alias.name) for alias in node.names), page
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    importlib.import_module(alias.name)
