"""`re3 ablate`: train and evaluate the models of the paper's ablation study (Re3, Table I)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from re3.apps.console import INTERRUPTED, failed, stderr
from re3.apps.training_data import DEFAULT_CACHE_GB, CacheOption, folders_sampler

if TYPE_CHECKING:
    from re3.apps.ablate_jobs import Means
    from re3.apps.ablate_study import Study
    from re3.data.sequence import Sequence
    from re3.evaluation.table_one_report import StudyReport
    from re3.network.table_one import Variant

DEFAULT_MINUTES = 20.0
LETTERS = "A,B,C,D,E,F,G,H,I,J,K"


def ablate(
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            "-d",
            help="Folder with training data, as of re3 train: datasets of videos, and stills for "
            "the simulated sequences; repeat for several.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    val: Annotated[
        Path | None,
        typer.Option(
            "--val",
            help="Folder with annotated clips to evaluate on.",
            metavar="DIR",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="Folder of the study. One found there is gone on with.",
            metavar="DIR",
        ),
    ] = Path("runs/ablation"),
    scale: Annotated[
        str,
        typer.Option(
            help="lite, about the size of re3-lite on a frozen trunk; or paper, the paper's sizes.",
            metavar="lite|paper",
        ),
    ] = "lite",
    minutes: Annotated[
        float | None,
        typer.Option(
            "--minutes-per-variant",
            help="Training of each variant: on a CPU in processor time, shared out among its "
            f"threads, on a GPU by the clock. Default: {DEFAULT_MINUTES:g}.",
            min=0.01,
            metavar="M",
            show_default=False,
        ),
    ] = None,
    iterations: Annotated[
        int | None,
        typer.Option(
            help="Train each variant for so many iterations instead.", min=1, show_default=False
        ),
    ] = None,
    variants: Annotated[
        str, typer.Option(help="Only these, separated by commas.", metavar="A,B")
    ] = LETTERS,
    recipe: Annotated[
        str | None,
        typer.Option(
            help="Curriculum and optimiser, as of re3 train; its length is scaled. Default: the "
            "scale's own.",
            metavar="NAME|FILE",
            show_default=False,
        ),
    ] = None,
    large: Annotated[
        str | None,
        typer.Option(
            help="Dataset of videos that A and I do without; several with commas between. Default: "
            "the one with most boxes.",
            metavar="NAME,NAME",
            show_default=False,
        ),
    ] = None,
    other: Annotated[
        str | None,
        typer.Option(
            help="Dataset of videos that H does without, or several. Default: the one with most "
            "boxes but for those.",
            metavar="NAME,NAME",
            show_default=False,
        ),
    ] = None,
    pretrained: Annotated[
        list[Path] | None,
        typer.Option(
            help="ImageNet weights for the convolutions that they fit, a file as of re3 weights "
            "import: at scale lite K needs AlexNet's; repeat for several.",
            metavar="FILE",
            show_default=False,
        ),
    ] = None,
    val_clips: Annotated[
        int | None,
        typer.Option(
            help="Evaluate on so many of the clips, evenly taken. Default: all.",
            min=1,
            show_default=False,
        ),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave out the dataset of this name; repeat for several.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of weights, data and noise.", min=0)] = 0,
    jobs: Annotated[
        int, typer.Option(help="Variants at a time, each in a process of its own.", min=1)
    ] = 1,
    threads: Annotated[
        int | None,
        typer.Option(
            help="Threads of each process, in training and in tracking. Default: the cores, shared "
            "out among the jobs.",
            min=1,
            show_default=False,
        ),
    ] = None,
    device: Annotated[str, typer.Option(help="To train on: cpu, or cuda for a GPU.")] = "cpu",
    cache_gb: CacheOption = DEFAULT_CACHE_GB,
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Only write and print the tables of the study in --out, as far as it has come; "
            "needs its --val, and nothing else.",
        ),
    ] = False,
    sizes: Annotated[
        bool,
        typer.Option(
            "--sizes",
            help="Only print what the variants of the scale are, with parameters and arithmetic; "
            "needs no data.",
        ),
    ] = False,
    speed: Annotated[
        bool,
        typer.Option(
            "--speed", help="With --sizes, also time steps of one object, with fresh weights."
        ),
    ] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="With --sizes, print Markdown, for a document.")
    ] = False,
) -> None:
    """Train and evaluate the variants A to K of the paper's ablation study.

    All have the same data, budget and seed. A variant that is finished is not
    trained or run again; one that was stopped goes on. The table is written
    to ablation.md and results.json in --out after each variant.

    Examples:

        re3 ablate -d videos -d stills --val clips --minutes-per-variant 20 -o runs/ablation

        re3 ablate --scale paper --sizes
    """
    try:
        from re3.apps.ablate_jobs import Means
        from re3.apps.ablate_output import show_sizes
        from re3.apps.ablate_study import Asked, Study
        from re3.apps.validation import clips_of
        from re3.cores import usable_cores
        from re3.network.table_one import SCALES
        from re3.training.ablation import chosen_sources
        from re3.training.errors import TrainingError
    except ImportError as error:
        raise failed(
            f"training needs more than tracking does ({error}): pip install 're3[train]'"
        ) from error
    stopped: int | None = None
    try:
        if scale not in SCALES:
            raise ValueError(f"unknown scale {scale!r}; expected one of {', '.join(SCALES)}")
        chosen = _chosen(variants)
        each = threads or max(1, usable_cores() // jobs)
        if sizes:
            show_sizes(SCALES[scale], chosen, each if speed else None, markdown=markdown)
            return
        if report:
            _report(Study(Asked.of(out), out, None), chosen)
            return
        if not data or val is None:
            raise ValueError("nothing to train or to evaluate on; expected --data and --val")
        if minutes is not None and iterations is not None:
            raise ValueError("minutes and iterations are given; expected one of them")
        sampler = folders_sampler(data, set(exclude or []), None, cache_gb)
        without_large, without_other = chosen_sources(sampler.sequences, large, other)
        asked = Asked(
            scale=scale,
            minutes=DEFAULT_MINUTES if minutes is None and iterations is None else minutes,
            iterations=iterations,
            recipe=recipe,
            seed=seed,
            data=tuple(map(str, data)),
            val=str(val),
            exclude=tuple(exclude or ()),
            val_clips=val_clips,
            large=without_large,
            other=without_other,
        )
        means = Means(each, device, tuple(pretrained or ()), cache_gb)
        study = Study(asked, out, sampler, each, means.pretrained, device)
        sequences = clips_of(val, val_clips)
        for variant in chosen:
            study.check(variant)
        asked.keep(out)
        stopped = _run(study, means, chosen, sequences, jobs)
    except KeyboardInterrupt:  # a second Ctrl-C, or one while tracking
        stderr().print("interrupted; run the same command to go on")
        raise typer.Exit(INTERRUPTED) from None
    except (ImportError, OSError, ValueError, TrainingError) as error:
        raise failed(error) from error
    if stopped is not None:
        raise typer.Exit(stopped)


def _chosen(letters: str) -> list[Variant]:
    """The variants named, in the order of the table."""
    from re3.network.table_one import VARIANTS

    wanted = {letter.strip().upper() for letter in letters.split(",") if letter.strip()}
    if not wanted or wanted - VARIANTS.keys():
        raise ValueError(
            f"--variants {letters!r}: expected letters of {LETTERS}, separated by commas"
        )
    return [variant for letter, variant in VARIANTS.items() if letter in wanted]


def _run(
    study: Study, means: Means, chosen: list[Variant], sequences: list[Sequence], jobs: int
) -> int | None:
    """Train, evaluate and report; the exit code if a signal asked to stop, or None."""
    from re3.apps.ablate_jobs import complete, complete_at_once
    from re3.apps.ablate_output import build_report, show_report, write_report

    console = stderr()

    def note() -> StudyReport:
        report = build_report(study, chosen, study.results(chosen, sequences))
        write_report(report, study.out)
        return report

    if jobs > 1:
        stopped = complete_at_once(study, means, chosen, jobs, console, note)
        if stopped is not None:
            return stopped
    else:
        for variant in chosen:
            stopped = complete(study, [variant], sequences, console)
            if stopped is not None:
                return stopped
            note()
    show_report(note())
    return None


def _report(study: Study, chosen: list[Variant]) -> None:
    """Write and print what is there."""
    from re3.apps.ablate_output import build_report, show_report, write_report
    from re3.apps.validation import clips_of

    sequences = clips_of(Path(study.asked.val), study.asked.val_clips)
    report = build_report(study, chosen, study.results(chosen, sequences))
    write_report(report, study.out)
    show_report(report)
