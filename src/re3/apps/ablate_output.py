"""What `re3 ablate` prints and writes."""

from __future__ import annotations

import json
import shlex
import sys
import tempfile
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from re3.apps.ablate_study import Study
from re3.engine import load_engine, zero_state
from re3.evaluation.ablation import ablation
from re3.evaluation.environment import Environment
from re3.evaluation.markdown import markdown_table
from re3.evaluation.one_pass import frames_per_second
from re3.evaluation.protocols import find_protocol
from re3.evaluation.result_files import write_whole
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.table_one import PAPER, judge
from re3.evaluation.table_one_report import Row, StudyReport, report_json, report_markdown
from re3.network.cost import cost
from re3.network.export import export_onnx
from re3.network.table_one import Scale, Variant
from re3.network.variants import Config, build

MARKDOWN, JSON = "ablation.md", "results.json"
WARM_UP, TIMED = 5, 40
"""Steps before the clock counts, and steps that are timed."""


def build_report(
    study: Study, chosen: list[Variant], results: dict[str, list[SequenceResult]]
) -> StudyReport:
    """The study as far as it has come; `results` by letter."""
    ready = [variant for variant in chosen if variant.letter in results]
    return StudyReport(
        scale=study.scale.name,
        command=shlex.join(["re3", *sys.argv[1:]]),
        asked=asdict(study.asked),
        environment=Environment.here(),
        conventions=find_protocol("ablation").conventions,
        clips=len(next(iter(results.values()), [])),
        rows=tuple(_row(study, variant, results[variant.letter]) for variant in ready),
        missing=tuple(variant.letter for variant in chosen if variant not in ready),
        verdicts=tuple(judge(results)),
    )


def _row(study: Study, variant: Variant, results: list[SequenceResult]) -> Row:
    costs, training = cost(study.scale.config(variant)), study.trained(variant)
    assert training is not None, "results come after training"
    return Row(
        letter=variant.letter,
        about=variant.about,
        fps=frames_per_second(result.track for result in results),
        figures=ablation(results),
        parameters=costs.parameters,
        flops=costs.flops,
        trained_as=study.trained_as(variant).letter,
        training=training,
    )


def write_report(report: StudyReport, out: Path) -> None:
    """Write `ablation.md` and `results.json`."""
    write_whole(out / MARKDOWN, report_markdown(report))
    write_whole(out / JSON, json.dumps(report_json(report), indent=2) + "\n")


def show_report(report: StudyReport) -> None:
    """Print figures and verdicts."""
    headings = ("FPS", "accuracy", "drops", "robustness", "average", "VOT 2014*", "Imagenet*")
    table = _table(f"Table I at scale {report.scale}", ["", "network and training"], headings)
    for row in report.rows:
        found, paper = row.figures, PAPER[row.letter]
        figures = [f"{row.fps:.0f}", f"{found.accuracy:.3f}", f"{found.drops}"]
        figures += [f"{found.robustness:.3f}", f"{found.average:.3f}"]
        figures += [f"{paper.vot.average:.3f}", f"{paper.imagenet.average:.3f}"]
        table.add_row(row.letter, escape(row.about), *figures)
    console = Console()
    console.print(table)
    console.print("* the average in the paper's own table")
    for verdict in report.verdicts:
        console.print(
            f"{verdict.judgement}: {verdict.conclusion.claim} ({verdict.conclusion.better} > "
            f"{verdict.conclusion.worse}: {verdict.difference:+.3f}, {verdict.low:+.3f} to "
            f"{verdict.high:+.3f})",
            markup=False,
            highlight=False,
        )


def show_sizes(
    scale: Scale, chosen: list[Variant], threads: int | None = None, *, markdown: bool = False
) -> None:
    """Print what the variants are, and what a step of one object costs.

    Args:
        scale: of the networks.
        chosen: variants.
        threads: to time steps with; None does not time any.
        markdown: print a table for a document, which says on what machine steps were timed.
    """
    names = ["", "network and training", "convolutions"]
    names += ["own", "simulated", "large", "other", "reset"]
    figures = ("parameters", "GFLOP a step", *([] if threads is None else ["steps a second"]))
    rows = _size_rows(scale, chosen, threads)
    if not markdown:
        table = _table(f"Table I at scale {scale.name}", names, figures)
        for row in rows:
            table.add_row(*map(escape, row))
        Console(width=None if sys.stdout.isatty() else 160).print(table)
        return
    lines = markdown_table([*names, *figures], rows, len(names))
    if threads is not None:
        here = Environment.here()
        lines += ["", f"{here.cpu}, {threads} threads, load {here.load:.1f}, {here.date}"]
    Console(soft_wrap=True, highlight=False).print("\n".join(lines), markup=False)


def _size_rows(scale: Scale, chosen: list[Variant], threads: int | None) -> list[list[str]]:
    timed: dict[Config, float] = {}
    rows = []
    for variant in chosen:
        config = scale.config(variant)
        costs = cost(config)
        said = (
            variant.own_predictions,
            variant.simulated,
            variant.large_source,
            variant.other_source,
            config.reset_interval > 0,
        )
        row = [variant.letter, variant.about, config.trunk]
        row += ["yes" if one else "no" for one in said]
        row += [f"{costs.parameters:,}", f"{costs.flops / 1e9:.2f}"]
        if threads is not None:
            # Variants that differ in training or in the reset alone are one network.
            network = replace(config, name="re3", reset_interval=0)
            if network not in timed:
                timed[network] = steps_per_second(network, threads)
            row.append(f"{timed[network]:.1f}")
        rows.append(row)
    return rows


def steps_per_second(config: Config, threads: int) -> float:
    """Steps of one object that ONNX Runtime makes in a second: one over the median time.

    Args:
        config: of the network, which gets fresh weights; times do not depend on them.
        threads: of ONNX Runtime.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        export_onnx(build(config), path)
        engine = load_engine(path, threads=threads)
    spec, rng = engine.spec, np.random.default_rng(0)
    previous, current = (
        None if crop is None else rng.integers(0, 256, (1, crop.size, crop.size, 3), dtype=np.uint8)
        for crop in (spec.previous, spec.current)
    )
    assert current is not None, "every network takes a current crop"
    state, seconds = zero_state(spec, 1), []
    for _ in range(WARM_UP + TIMED):
        started = time.perf_counter()
        state = engine.step(previous, current, state).state
        seconds.append(time.perf_counter() - started)
    return float(1 / np.median(seconds[WARM_UP:]))


def _table(title: str, names: list[str], figures: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in names:
        table.add_column(name)
    for name in figures:
        table.add_column(name, justify="right", no_wrap=True)
    return table
