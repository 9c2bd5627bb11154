"""An ablation study as Markdown and as JSON: its figures beside the paper's, and what they say."""

from __future__ import annotations

import math
from collections.abc import Sequence as Several
from dataclasses import asdict, dataclass
from typing import Any

from re3.evaluation.ablation import Ablation
from re3.evaluation.environment import Environment
from re3.evaluation.markdown import markdown_table
from re3.evaluation.table_one import PAPER, PaperFigures, Verdict


@dataclass(frozen=True)
class Row:
    """A variant of the study.

    Attributes:
        letter, about: of the variant.
        fps: updates over the time that all of them took.
        figures: of the protocol.
        parameters: number of learnt values.
        flops: operations of a step of one object.
        trained_as: letter of the variant whose weights it has, mostly its own.
        training: iterations, seconds, pairs, last_overlap and the sources' shares.
    """

    letter: str
    about: str
    fps: float
    figures: Ablation
    parameters: int
    flops: int
    trained_as: str
    training: dict[str, Any]


@dataclass(frozen=True)
class StudyReport:
    """A study, as far as it has come.

    Attributes:
        scale: of the networks.
        command: what was typed.
        asked: budget, seed and data, by name.
        environment: machine, date and versions.
        conventions: of the protocol.
        clips: how many it was evaluated on.
        rows: of the variants that are ready.
        missing: letters of those that are not.
        verdicts: on the paper's conclusions.
    """

    scale: str
    command: str
    asked: dict[str, Any]
    environment: Environment
    conventions: str
    clips: int
    rows: tuple[Row, ...]
    missing: tuple[str, ...]
    verdicts: tuple[Verdict, ...]


def report_json(report: StudyReport) -> dict[str, Any]:
    """Everything, for programs; what is not defined is null."""
    values = {
        **asdict(report),
        "rows": [{**asdict(row), "paper": asdict(PAPER[row.letter])} for row in report.rows],
        "verdicts": [
            {
                **asdict(verdict),
                "judgement": verdict.judgement,
                "paper_vot": round(verdict.paper_difference("vot"), 3),
                "paper_imagenet": round(verdict.paper_difference("imagenet"), 3),
            }
            for verdict in report.verdicts
        ],
    }
    defined: dict[str, Any] = _defined(values)
    return defined


def report_markdown(report: StudyReport) -> str:
    """The tables, for people."""
    environment = report.environment
    versions = ", ".join(f"{name} {version}" for name, version in environment.versions.items())
    lines = [
        f"# Ablation study at scale {report.scale} (Re3, Table I)",
        "",
        f"- command: `{report.command}`",
        *(f"- {name}: {_said(value)}" for name, value in report.asked.items()),
        f"- clips: {report.clips}",
        f"- machine: {environment.cpu}, {environment.cores} cores, {environment.system}, load "
        f"{environment.load:.1f}",
        f"- date: {environment.date}",
        f"- versions: {versions}",
        "",
        f"{report.conventions} FPS: updates over the time that all of them took, without decoding.",
        "",
        "The paper's figures, from its Table I, are of its own networks, with far more training, "
        "on other clips and another machine: only differences between rows can be compared.",
        "",
    ]
    lines += markdown_table(
        ["", "network and training", "FPS", *_HEADINGS]
        + ["paper: FPS", *(f"VOT 2014 {h}" for h in _HEADINGS)]
        + [f"Imagenet Video {h}" for h in _HEADINGS],
        [_figures_row(row) for row in report.rows],
        left=2,
    )
    if report.missing:
        lines += ["", f"Not ready yet: {', '.join(report.missing)}."]
    lines += ["", "## Which of the paper's conclusions hold", ""]
    lines += _verdicts(report.verdicts)
    lines += ["", "## Sizes and training", ""]
    lines += markdown_table(
        _TRAINING_HEADINGS,
        [_training_row(row) for row in report.rows],
        left=1,
    )
    return "\n".join(lines) + "\n"


_HEADINGS = ("accuracy", "drops", "robustness", "average")
_TRAINING_HEADINGS = (
    "",
    "parameters",
    "GFLOP a step",
    "weights of",
    "iterations",
    "minutes",
    "pairs",
    "overlap at the end",
    "share of the clips, by source",
)


def _figures_row(row: Row) -> list[str]:
    paper, found = PAPER[row.letter], row.figures
    ours = [f"{found.accuracy:.3f}", f"{found.drops}"]
    ours += [f"{found.robustness:.3f}", f"{found.average:.3f}"]
    theirs = [cell for figures in (paper.vot, paper.imagenet) for cell in _paper_cells(figures)]
    return [row.letter, row.about, f"{row.fps:.1f}", *ours, f"{paper.fps:.2f}", *theirs]


def _paper_cells(figures: PaperFigures) -> list[str]:
    return [
        f"{figures.accuracy:.2f}",
        f"{figures.drops}",
        f"{figures.robustness:.2f}",
        f"{figures.average:.3f}",
    ]


def _verdicts(verdicts: Several[Verdict]) -> list[str]:
    if not verdicts:
        return ["No two rows that the paper compares are ready."]
    rows = [
        [
            verdict.conclusion.claim,
            f"{verdict.conclusion.better} > {verdict.conclusion.worse}",
            verdict.judgement,
            f"{verdict.difference:+.3f}",
            f"{verdict.low:+.3f} to {verdict.high:+.3f}",
            f"{verdict.paper_difference('vot'):+.3f}",
            f"{verdict.paper_difference('imagenet'):+.3f}",
        ]
        for verdict in verdicts
    ]
    header = ["conclusion", "rows", "here", "difference", "95 % of draws"]
    said = [
        f"{judgement.capitalize()}: {', '.join(claims) if claims else 'none'}."
        for judgement in ("holds", "does not hold", "undecided")
        for claims in [[v.conclusion.claim for v in verdicts if v.judgement == judgement]]
    ]
    return [
        *markdown_table([*header, "paper: VOT 2014", "Imagenet Video"], rows, left=3),
        "",
        *said,
        "",
        "The difference is that of the averages. A conclusion holds, or does not, where the middle "
        "95 % of the differences are on one side of zero when the clips are drawn again with "
        "replacement. That says nothing of another seed of the training.",
    ]


def _training_row(row: Row) -> list[str]:
    training = row.training
    shares = (f"{name} {share:.0%}" for name, share in training["sources"].items())
    return [
        row.letter,
        f"{row.parameters:,}",
        f"{row.flops / 1e9:.2f}",
        row.trained_as,
        f"{training['iterations']}",
        f"{training['seconds'] / 60:.1f}",
        f"{training['pairs']}",
        f"{training['last_overlap']:.3f}",
        "; ".join(shares),
    ]


def _said(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or "none"
    return "none" if value is None else str(value)


def _defined(value: Any) -> Any:
    """The same without NaN, which JSON has not."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {name: _defined(one) for name, one in value.items()}
    return [_defined(one) for one in value] if isinstance(value, list | tuple) else value
