"""The documentation builds without warnings; its pictures, tables and notebook are up to date."""

import importlib.util
import re
import subprocess
import sys

import cv2
import pytest

import re3
from documents import PAGES, ROOT, text_of
from re3.models import list_models

IMAGES = ROOT / "docs" / "images"
LARGEST_PICTURE, ALL_PICTURES = 150_000, 1_000_000


def run(script, *arguments):
    return subprocess.run(
        [sys.executable, f"tools/{script}", *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )


def tool(name, monkeypatch):
    """A module of the folder tools."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    return importlib.import_module(name)


def test_the_site_builds_without_warnings():
    pytest.importorskip("zensical", reason='needs the extra "docs"')
    done = run("build_docs.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "no warnings" in done.stdout
    assert (ROOT / "site" / "how-it-works" / "index.html").is_file()
    # The reference was filled from the docstrings.
    assert "expected overlap (IoU)" in (ROOT / "site" / "api" / "index.html").read_text()


def test_a_build_that_complains_is_a_failure(monkeypatch):
    build_docs = tool("build_docs", monkeypatch)
    told = "Build started\n\x1b[33mgriffe: src/re3/x.py:9: No type\x1b[0m\nNo issues found\n"
    assert build_docs.complaints(told) == ["griffe: src/re3/x.py:9: No type"]
    assert build_docs.complaints("Build started\nNo issues found\n") == []


def test_a_page_beside_the_navigation_is_a_failure(monkeypatch, tmp_path):
    build_docs = tool("build_docs", monkeypatch)
    (tmp_path / "there.md").touch()
    (tmp_path / "forgotten.md").touch()
    navigation = [{"A": "there.md"}, {"B": [{"C": "missing.md"}]}]
    missing, forgotten = build_docs.navigation_gaps(navigation, tmp_path)
    assert missing.startswith("missing.md is in the navigation")
    assert forgotten.startswith("forgotten.md is not in the navigation")


def test_the_tables_are_up_to_date():
    done = run("tables.py", "--check")
    assert done.returncode == 0, done.stdout


def test_the_cards_say_what_the_reports_say(monkeypatch):
    cards = tool("cards", monkeypatch)
    for card in list_models():
        if card.shipped:
            measured = cards.measured(card.name)
            assert measured.pop("accuracy") == card.accuracy
            assert measured.pop("speed_fps") == card.speed_fps
            assert measured == {name: card.details[name] for name in measured}


def test_a_page_without_figures_is_no_report(monkeypatch, tmp_path):
    pages = tool("report_pages", monkeypatch)
    (tmp_path / "page.md").write_text("# Speed\n\n## Remarks\n\n- none\n")
    with pytest.raises(ValueError, match=r"page\.md has no figures of any dataset; expected a rep"):
        pages.read_page(tmp_path / "page.md")


def test_a_report_is_read_by_dataset_and_table(monkeypatch, tmp_path):
    pages = tool("report_pages", monkeypatch)
    (tmp_path / "page.md").write_text(
        "# One pass\n\n- command: `re3 eval a`\n\n## a: 1 sequence, ope\n\n"
        "| tracker | AUC |\n| --- | ---: |\n| kcf | 0.5 |\n\n### AUC by sequence\n\n"
        "| sequence | kcf |\n| --- | ---: |\n| one | 0.5 |\n\n## Remarks\n\n- none\n"
    )
    page = pages.read_page(tmp_path / "page.md")
    assert page.head == {"command": "`re3 eval a`"}
    assert page.datasets == {
        "a": {
            "": [["tracker", "AUC"], ["kcf", "0.5"]],
            "AUC by sequence": [["sequence", "kcf"], ["one", "0.5"]],
        }
    }
    assert pages.column(page.datasets["a"][""], "AUC") == {"kcf": "0.5"}


def test_every_picture_is_used_made_by_a_command_and_small():
    made = set(run("figures.py", "--list").stdout.split())
    measured = (ROOT / "benchmarks" / "figures.py").read_text(encoding="utf-8")
    made |= set(re.findall(r"docs/images/([\w.-]+)", measured))
    shown = {
        name
        for page in PAGES
        for name in re.findall(r"\((?:docs/)?images/([^)]+)\)", text_of(page))
    }
    kept = {path.name: path.stat().st_size for path in IMAGES.iterdir()}
    assert shown == made == set(kept)
    assert max(kept.values()) < LARGEST_PICTURE
    assert sum(kept.values()) < ALL_PICTURES


def test_pictures_of_the_bundled_clip_can_be_made_again(tmp_path):
    done = run("figures.py", "loose", "--out", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    again, kept = (cv2.imread(str(folder / "loose.jpg")) for folder in (tmp_path, IMAGES))
    # A picture of the same frames with about the same boxes.
    assert again.shape == kept.shape
    assert cv2.absdiff(again, kept).mean() < 3


def test_diagrams_can_be_made_again(tmp_path, monkeypatch):
    for needed in ("torch", "matplotlib"):
        pytest.importorskip(needed, reason='needs the extras "train" and "report"')
    figures = tool("figures", monkeypatch)
    for name in ("network-re3.svg", "network-re3-lite.svg"):
        figures.write(figures.make(tmp_path / name, tmp_path), tmp_path / name)
        text = (tmp_path / name).read_text()
        assert "<svg" in text
        assert "LSTM" in text


def test_a_missing_clip_and_an_unknown_picture_are_told(tmp_path):
    missing = run("figures.py", "left", "--clips", tmp_path, "--out", tmp_path)
    assert missing.returncode == 2
    assert "sample-videos" in missing.stdout
    unknown = run("figures.py", "nothing")
    assert unknown.returncode == 2
    assert "no figure is called nothing" in unknown.stdout


def outputs(notebook):
    """Text of each output of a notebook; of a picture its kind."""
    found = []
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            found.append(
                "picture" if "image/jpeg" in data else output.get("text") or data["text/plain"]
            )
    return found


def test_the_notebook_runs_and_shows_what_it_is_kept_with(monkeypatch):
    for needed in ("nbclient", "ipykernel"):
        if importlib.util.find_spec(needed) is None:
            pytest.skip(f'needs {needed}, of the extra "dev"')
    import nbformat

    notebook = tool("notebook", monkeypatch)
    assert notebook.NOTEBOOK.stat().st_size < 300_000
    kept = nbformat.read(notebook.NOTEBOOK, as_version=4)
    nbformat.validate(kept)
    before = outputs(kept)
    after = outputs(notebook.run(kept))
    assert before.count("picture") == 2
    number = r"-?\d+\.?\d*"
    assert [re.sub(number, "#", text) for text in after] == [
        re.sub(number, "#", text) for text in before
    ]
    for fresh, old in zip(after, before, strict=True):
        found, expected = ([float(n) for n in re.findall(number, t)] for t in (fresh, old))
        assert found == pytest.approx(expected, rel=0.1, abs=3)


def test_version_and_citation_agree():
    yaml = pytest.importorskip("yaml", reason='needs PyYAML, of the extra "train"')
    citation = yaml.safe_load(text_of(ROOT / "CITATION.cff"))
    assert citation["version"] == re3.__version__
    assert re.search(rf"^## {re.escape(re3.__version__)}\b", text_of(ROOT / "CHANGELOG.md"), re.M)


def test_trackers_measured_later_are_added_to_a_report(monkeypatch, tmp_path):
    pages = tool("report_pages", monkeypatch)
    head = "# One pass\n\n- command: `re3 eval a`\n\n## a: 2 sequences, ope\n\n"
    (tmp_path / "page.md").write_text(
        f"{head}| tracker | AUC | SR.50 |\n| --- | ---: | ---: |\n| kcf | 0.5 | 0.6 |\n\n"
        "### AUC by sequence\n\n| sequence | frames | kcf |\n| --- | ---: | ---: |\n"
        "| one | 5 | 0.5 |\n| two | 6 | 0.4 |\n"
    )
    (tmp_path / "page-added.md").write_text(
        f"{head}| tracker | FPS | AUC |\n| --- | ---: | ---: |\n| kcf | 9 | 0.9 |\n"
        "| new | 8 | 0.7 |\n\n## b: 1 sequence, ope\n\n| tracker | AUC |\n| --- | ---: |\n"
        "| new | 0.1 |\n\n## a: 2 sequences, ope\n\n| tracker | FPS | AUC |\n"
        "| --- | ---: | ---: |\n| kcf | 9 | 0.9 |\n| new | 8 | 0.7 |\n\n"
        "### AUC by sequence\n\n| sequence | frames | kcf | new |\n"
        "| --- | ---: | ---: | ---: |\n| two | 6 | 0.9 | 0.8 |\n"
    )
    page = pages.read_page(tmp_path / "page.md")
    assert page.datasets == {
        "a": {
            "": [["tracker", "AUC", "SR.50"], ["kcf", "0.5", "0.6"], ["new", "0.7", "-"]],
            "AUC by sequence": [
                ["sequence", "frames", "kcf", "new"],
                ["one", "5", "0.5", "-"],
                ["two", "6", "0.4", "0.8"],
            ],
        }
    }
