"""Variants of a study, one after the other or several at a time in processes of their own."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.context import SpawnProcess
from pathlib import Path

import cv2
from rich.console import Console

from re3.apps.ablate_study import Asked, Study
from re3.apps.console import WRONG_INPUT, stderr
from re3.apps.stopping import StopSignals
from re3.apps.train_report import Report
from re3.apps.training_data import folders_sampler
from re3.apps.validation import clips_of
from re3.data.sequence import Sequence
from re3.evaluation.runner import Progress as EvaluationProgress
from re3.evaluation.workers import detach
from re3.network.table_one import VARIANTS, Variant
from re3.training.errors import TrainingError

LOG = "output.log"
"""In a variant's folder: what its process says."""

_POLL = 0.2
"""Seconds between looks at the processes."""


@dataclass(frozen=True)
class Means:
    """What a study is computed with; none of it decides what comes out.

    Attributes:
        threads: of each process: of torch, ONNX Runtime and OpenCV.
        device: to train on.
        pretrained: files of convolutions, for the variants that they fit.
        cache_gb: disk space for decoded frames.
    """

    threads: int
    device: str
    pretrained: tuple[Path, ...]
    cache_gb: float


def open_study(asked: Asked, out: Path, means: Means) -> Study:
    """The study in a folder, with its data.

    Raises:
        ValueError, OSError: the data cannot be read.
    """
    data = folders_sampler([Path(d) for d in asked.data], set(asked.exclude), None, means.cache_gb)
    return Study(asked, out, data, means.threads, means.pretrained, means.device)


def complete(
    study: Study, variants: list[Variant], sequences: list[Sequence], console: Console
) -> int | None:
    """Train and evaluate variants, as far as that is not done.

    Returns:
        the exit code if a signal asked to stop; None when all is done.
    """
    cv2.setNumThreads(study.threads)
    for variant in variants:
        letter = study.trained_as(variant).letter
        weights = "" if letter == variant.letter else f", with the weights of {letter}"
        console.print(f"{variant.letter}: {variant.about}{weights}", markup=False)
        if study.trained(variant) is None:
            with StopSignals() as stop, Report(console) as report:
                over = study.train(variant, report, stop)
            if not over:
                console.print(f"stopped by {stop.name}; run the same command to go on")
                return stop.exit_code
        study.evaluate(variant, sequences, lambda progress: _say(console, progress))
    return None


def complete_at_once(
    study: Study,
    means: Means,
    variants: list[Variant],
    jobs: int,
    console: Console,
    on_end: Callable[[], object],
) -> int | None:
    """The same, so many at a time; variants with the same weights share a process.

    Args:
        study: with what was asked.
        means: for each process.
        variants: to train and evaluate.
        jobs: processes at a time.
        console: told when one begins and ends; each writes into its own `output.log`.
        on_end: called after each process that did all it was to do.

    Raises:
        TrainingError: a process failed; the others were completed.
    """
    waiting = _together(study, variants)[::-1]
    running: dict[str, SpawnProcess] = {}
    failures: list[str] = []
    with StopSignals() as stop, ExitStack() as stack:
        stack.callback(_end, running)
        while (waiting or running) and not stop():
            while waiting and len(running) < jobs:
                letters = waiting.pop()
                running[letters] = _start(study.asked, study.out, means, letters)
                console.print(f"{letters}: see {study.out / letters[0] / LOG}", markup=False)
            time.sleep(_POLL)
            for letters, process in list(running.items()):
                if process.exitcode is None:
                    continue
                del running[letters]
                if process.exitcode == 0:
                    on_end()
                else:
                    failures.append(
                        f"the process of {letters} ended with exit code {process.exitcode}; see "
                        f"{study.out / letters[0] / LOG}"
                    )
                console.print(failures[-1] if process.exitcode else f"{letters}: done")
    if stop():
        console.print(f"stopped by {stop.name}; run the same command to go on")
        return stop.exit_code
    if failures:
        raise TrainingError("; ".join(failures))
    return None


def _together(study: Study, variants: list[Variant]) -> list[str]:
    """Letters of the variants, those with the same weights in one word."""
    groups: dict[str, str] = {}
    for variant in variants:
        trained_as = study.trained_as(variant).letter
        groups[trained_as] = groups.get(trained_as, "") + variant.letter
    return list(groups.values())


def _start(asked: Asked, out: Path, means: Means, letters: str) -> SpawnProcess:
    process = multiprocessing.get_context("spawn").Process(
        target=_work, args=(asked, out, means, letters), name=f"re3-ablate-{letters}"
    )
    process.start()
    return process


def _end(running: dict[str, SpawnProcess]) -> None:
    """Ask processes to stop, which write their checkpoints first, and wait for them."""
    for process in running.values():
        process.terminate()
    for process in running.values():
        process.join()


def _work(asked: Asked, out: Path, means: Means, letters: str) -> None:
    """What a process does."""
    folder = out / letters[0]
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOG).open("a", encoding="utf-8") as log:
        os.dup2(log.fileno(), 2)
    detach()
    console = stderr()
    try:
        study = open_study(asked, out, means)
        sequences = clips_of(Path(asked.val), asked.val_clips)
        code = complete(study, [VARIANTS[letter] for letter in letters], sequences, console)
    except (OSError, ValueError, TrainingError) as error:
        console.print(f"error: {error}", markup=False)
        code = WRONG_INPUT
    raise SystemExit(code or 0)


def _say(console: Console, progress: EvaluationProgress) -> None:
    if progress.ended:
        name, done = progress.sequence.name, progress.frames_before + progress.frames
        console.print(
            f"{progress.tracker} {name}: {done}/{progress.frames_total} frames", markup=False
        )
