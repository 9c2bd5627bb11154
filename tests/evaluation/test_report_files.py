"""The files of a report, from results made up of given boxes."""

import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from re3.data.sequence import Sequence
from re3.evaluation.environment import Environment
from re3.evaluation.html_report import to_html
from re3.evaluation.occlusion import occlusion_table
from re3.evaluation.one_pass import Track
from re3.evaluation.plots_curves import occluded_success, pooled_success
from re3.evaluation.plots_results import dataset_plots, report_plots
from re3.evaluation.plots_style import styles
from re3.evaluation.protocols import find_protocol
from re3.evaluation.report import write_reports
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.summary import Run
from re3.evaluation.supervised import Step, SupervisedTrack

EVIL = "<script>alert(1)</script>"


def result_of(tracker, sequence, boxes, failure=None, seconds=0.01):
    count = len(sequence)
    boxes = np.array(boxes, dtype=float)
    track = Track(boxes, np.ones(count), np.full(count, seconds), failure)
    return SequenceResult.of(tracker, sequence, track)


@pytest.fixture(scope="module")
def run(tmp_path_factory, moving_patch) -> Run:
    """Two trackers on a clip with frames, where the first one loses it, and one without."""
    folder = tmp_path_factory.mktemp("clips") / "patch"
    folder.mkdir()
    images, boxes = moving_patch
    for index, image in enumerate(images):
        cv2.imwrite(str(folder / f"{index:04d}.png"), image)
    occluded = np.arange(12) > 8
    patch = Sequence("patch", folder, boxes, None, "made", 0, occluded, ("fast motion",))
    unreadable = Sequence("no & file", folder / "gone", [(0, 0, 10, 10)] * 12, dataset="made")
    lost = patch.boxes_xywh.copy()
    lost[6:, 0] = 0
    lost[6:, 1] = 90
    gone = np.tile([500.0, 0, 10, 10], (12, 1))
    return Run(
        command=f"re3 eval {EVIL}",
        data=("data/made",),
        environment=Environment("CPU", 2, 0.25, "Linux", "2024-05-06", {"re3": "1.2.3"}),
        protocol=find_protocol("ope"),
        jobs=1,
        results=[
            result_of(EVIL, patch, lost),
            result_of("other", patch, patch.boxes_xywh, seconds=0.002),
            result_of(EVIL, unreadable, gone),
            result_of("other", unreadable, gone, "frame 3: update raised"),
        ],
    )


class Page(HTMLParser):
    """The elements of a page and the text in it."""

    VOID = frozenset({"meta", "img", "br", "hr", "link", "input"})

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.text, self.open = [], [], "", []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *attr) for attr in attrs]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *attr) for attr in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


@pytest.fixture
def extra():
    """A test that asks for it is skipped where the extra `report` is not installed."""
    for module in ("matplotlib", "jinja2"):
        pytest.importorskip(module, reason=f'needs {module}: pip install "re3[report]"')


@pytest.fixture
def without_plots(extra, monkeypatch):
    """Drawing takes seconds."""
    monkeypatch.setattr("re3.evaluation.plots_results.dataset_plots", lambda *_: [])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report") / "out"


@pytest.fixture(scope="module")
def written(run, folder):
    for module in ("matplotlib", "jinja2"):
        pytest.importorskip(module, reason=f'needs {module}: pip install "re3[report]"')
    return write_reports(run, folder)


@pytest.fixture(scope="module")
def page(written) -> Page:
    return Page(next(path for path in written if path.suffix == ".html").read_text("utf-8"))


def test_every_file_is_there_and_listed(written, folder):
    names = {path.relative_to(folder).as_posix() for path in written}
    expected = {"results.json", "results.csv", "report.md", "report.html"}
    for plot in (
        "success",
        "precision",
        "normalised-precision",
        "trade-off",
        "occlusion",
        "occlusion-success",
        "sequences",
        "attributes",
        "latency",
    ):
        expected |= {f"plots/{plot}-made.svg", f"plots/{plot}-made.pdf"}
    assert names == expected
    there = [path for path in folder.rglob("*") if path.is_file()]
    assert {path.relative_to(folder).as_posix() for path in there} == names


def test_the_page_refers_to_nothing_outside(page):
    for tag, name, value in page.attributes:
        if name in ("src", "href", "xlink:href", "action", "data", "poster", "srcset"):
            assert re.match(r"#|data:image/jpeg;base64,", value), (tag, name, value)
    assert not {"link", "iframe", "object", "embed", "base"} & set(page.tags)
    assert page.tags.count("script") == 1


def test_the_page_has_no_address_in_its_styles(written):
    text = next(path for path in written if path.suffix == ".html").read_text("utf-8")
    assert "http:" not in text and "https:" not in text
    assert "@import" not in text
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))


def test_names_are_escaped(page, written):
    text = next(path for path in written if path.suffix == ".html").read_text("utf-8")
    assert EVIL not in text
    assert f"Losses of {EVIL}" in page.text
    assert "no & file" in page.text
    assert f"re3 eval {EVIL}" in page.text


def test_the_page_is_well_formed_and_no_id_comes_twice(page):
    assert page.open == []
    identities = [value for _, name, value in page.attributes if name == "id"]
    assert len(identities) == len(set(identities)) > 50


def test_the_page_has_every_plot(page):
    assert page.tags.count("figure") == 9
    for title in ("Success: made, 2 sequences", "made: AUC by attribute", "fast motion (1)"):
        assert title in page.text
    # The legend of the success plot: mean of 20/21 and the first frame's share.
    mean = (20 / 21 + 20 / 21 / 12) / 2
    assert f"[{mean:.3f}] other" in page.text


def test_losses_come_with_pictures_or_the_reason_why_not(page):
    assert "Lost on 2 of 2 sequences" in page.text
    # The patch is lost from frame 6 to the end; the one without frames from frame 1.
    strips = [v for tag, name, v in page.attributes if tag == "img" and name == "src"]
    assert len(strips) == 5 and len(set(strips)) == 5
    text = " ".join(page.text.split())
    assert "lost in frame 6 of 12, not found again: the tracker's box jumped" in text
    assert "lost in frame 1 of 12, not found again" in text
    assert text.count("No pictures:") == 1


def test_the_page_says_the_figures_of_its_protocol(page):
    text = " ".join(page.text.split())
    assert "One-pass evaluation" in text
    assert "made: 2 sequences, ope" in text
    for heading in ("AUC", "P@20", "p99 ms", "reading ms", "AUC by sequence", "P@20 by sequence"):
        assert heading in text
    # Frames 9 to 11 of the one sequence with marks.
    assert "All frames and occluded frames" in text and "3 of 12" in text
    assert "sequences at the same time: 1" in text


def test_another_tracker_can_be_shown(run, tmp_path, without_plots):
    write_reports(run, tmp_path, tracker="other")
    text = " ".join((tmp_path / "report.html").read_text("utf-8").split())
    assert "Lost on 1 of 2 sequences" in text
    with pytest.raises(ValueError, match="no results of tracker 'gone'; there are some of <script"):
        write_reports(run, tmp_path, tracker="gone")
    with pytest.raises(ValueError, match="without results"):
        write_reports(replace(run, results=[]), tmp_path)


def test_losses_are_those_of_the_first_repetition(run, tmp_path, without_plots):
    again = [replace(result, repeat=1) for result in run.results]
    write_reports(replace(run, results=[*run.results, *again]), tmp_path)
    text = " ".join((tmp_path / "report.html").read_text("utf-8").split())
    assert "Lost on 2 of 2 sequences in the first repetition" in text


def test_curves_under_occlusion_are_those_of_the_table(run):
    marked = [r for r in run.results if r.sequence.occluded is not None]
    everywhere, occluded = pooled_success(marked), occluded_success(marked)
    table = occlusion_table(run.results)
    assert [(c.tracker, c.figure) for c in everywhere] == [
        (row.tracker, pytest.approx(row.everywhere.auc)) for row in table
    ]
    assert [c.figure for c in occluded] == [pytest.approx(row.occluded.auc) for row in table]
    assert occluded[0].figure == 0.0  # lost before the object was hidden


def test_all_boxes_together_have_one_curve(run, extra):
    pooled = replace(run, protocol=find_protocol("imagenet-vid"), results=run.results[1::2])
    plots = {p.name: p for p in dataset_plots(pooled, "made", "made", styles(["other"]))}
    assert "success-made" in plots and "precision-made" not in plots
    assert "All boxes of all sequences thrown together" in plots["success-made"].caption
    (row,) = pooled.tracker_rows
    # 13 of 24 boxes are right; the trade-off has 11 of 22, without first frames.
    assert row.figures.mean["auc"] == pytest.approx(13 / 24 * 20 / 21)
    (text,) = plots["success-made"].figure.axes[0].get_legend().get_texts()
    assert text.get_text() == f"[{13 / 24 * 20 / 21:.3f}] other"
    axes = plots["trade-off-made"].figure.axes[0]
    np.testing.assert_allclose(axes.collections[0].get_offsets(), [[0.5, 0.5]])


@pytest.fixture
def restarts(run) -> list[SequenceResult]:
    """Lost once in 12 frames, started again in the last but one."""
    sequence = run.results[1].sequence
    steps = np.full(12, Step.FOLLOWED, np.int8)
    steps[0], steps[4], steps[5:10] = Step.STARTED, Step.FAILED, Step.SKIPPED
    steps[10] = Step.STARTED
    boxes = sequence.boxes_xywh.copy()
    boxes[4:10] = np.nan
    seconds = np.where(steps == Step.SKIPPED, np.nan, 0.01)
    return [SequenceResult.of("again", sequence, SupervisedTrack(boxes, steps, seconds))]


@pytest.mark.parametrize(
    ("protocol", "point", "x_label", "y_label"),
    [
        # Frames 0 to 3 with overlap 1, the failure with 0; what follows the restart is left out.
        ("ablation", (np.exp(-30 / 12), 0.8), "robustness: exp(-30 · drops", "accuracy: mean over"),
        # Ten frames from each start do not count: none is left.
        ("vot", (np.exp(-30 / 12), 0.0), "robustness S(30): chance", "accuracy A: mean overlap"),
    ],
)
def test_restarts_are_drawn_with_their_protocols_figures(
    run, restarts, extra, protocol, point, x_label, y_label
):
    again = replace(run, protocol=find_protocol(protocol, "vot2014"), results=restarts)
    plots = dataset_plots(again, "made", "made", styles(["again"]))
    assert [plot.name for plot in plots] == ["trade-off-made", "latency-made"]
    axes = plots[0].figure.axes[0]
    np.testing.assert_allclose(axes.collections[0].get_offsets(), [point])
    assert axes.get_xlabel().startswith(x_label) and axes.get_ylabel().startswith(y_label)
    text = to_html(again, {"made": plots}, styles(["again"]))
    assert again.protocol.title.split(",")[0] in text.replace("&#39;", "'")
    assert f"made: 1 sequence, {protocol}" in text
    assert "Losses of" not in text and "AUC" not in text


def test_speeds_of_trackers_that_ran_side_by_side_are_not_drawn(run, extra):
    names = [plot.name for plot in dataset_plots(run, "made", "made", styles(run.trackers))]
    together = dataset_plots(replace(run, jobs=2), "made", "made", styles(run.trackers))
    assert "latency-made" in names
    assert [plot.name for plot in together] == [name for name in names if "latency" not in name]
    (trade_off,) = [plot for plot in together if plot.name == "trade-off-made"]
    said = [a.get_text() for a in trade_off.figure.findobj(lambda a: hasattr(a, "get_text"))]
    assert not any("(" in text and "FPS" in text for text in said)


def test_what_is_nobodys_fault_is_left_out_of_the_plots(run, extra):
    sequence = run.results[1].sequence
    track = Track(np.full((12, 4), np.nan), np.full(12, np.nan), np.full(12, np.nan), "broken")
    result = SequenceResult.of("a", sequence, replace(track, unscored=True))
    assert dataset_plots(replace(run, results=[result]), "made", "made", styles("a")) == []


def test_datasets_of_like_names_have_files_of_their_own(run, monkeypatch):
    slugs = []
    monkeypatch.setattr(
        "re3.evaluation.plots_results.dataset_plots",
        lambda run, dataset, slug, styles: slugs.append((dataset, slug)),
    )
    results = [
        replace(result, sequence=replace(result.sequence, dataset=name))
        for result, name in zip(run.results, ("a b", "a/b", "", "a b"), strict=True)
    ]
    report_plots(replace(run, results=results), {})
    assert slugs == [("a b", "a-b"), ("a/b", "a-b-2"), ("", "sequences")]


def test_text_is_written_even_without_the_extra(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"re3\[report\]"):
        write_reports(run, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == [
        "report.md",
        "results.csv",
        "results.json",
    ]
    assert len(json.loads((tmp_path / "results.json").read_text())["sequences"]) == 4
