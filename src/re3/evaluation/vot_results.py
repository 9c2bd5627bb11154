"""What the VOT toolkit leaves in a workspace: trajectories, and the figures of its analyses."""

from __future__ import annotations

import json
from collections.abc import Iterable
from collections.abc import Sequence as List
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from re3.data.formats.vot import read_truth
from re3.evaluation.supervised import Step, SupervisedTrack
from re3.evaluation.vot import VotRuns, VotStack
from re3.evaluation.vot_workspace import EXPERIMENT

_CODES = {"0": Step.SKIPPED, "1": Step.STARTED, "2": Step.FAILED}


@dataclass(frozen=True)
class OfficialScores:
    """What the toolkit's analyses say of one tracker; None where the stack has no such analysis.

    Attributes:
        accuracy, robustness, reliability: as in `re3.evaluation.vot.VotScores`.
        failures: over all sequences.
        eao: NaN where the sequences are too short for the stack's interval.
    """

    accuracy: float
    robustness: float
    reliability: float
    failures: float | None
    eao: float | None


def read_runs(
    workspace: Path, identifier: str, names: Iterable[str], repetitions: int
) -> list[VotRuns]:
    """Read a tracker's trajectories back.

    Args:
        workspace: its folder.
        identifier: of the tracker.
        names: of the sequences.
        repetitions: of the stack; trajectories beyond are not looked at.

    Raises:
        FileNotFoundError: a sequence has no trajectory.
        ValueError: a file is not well formed.
    """
    return [_read_sequence_runs(workspace, identifier, name, repetitions) for name in names]


def read_analysis(path: Path, identifiers: List[str], stack: VotStack) -> list[OfficialScores]:
    """Read what `vot analysis --format json` wrote.

    Args:
        path: the JSON file.
        identifiers: of the trackers, as they were handed to the toolkit.
        stack: of the workspace.

    Returns:
        the figures in the order of the trackers.

    Raises:
        ValueError: the file does not hold the experiment, its analyses or all trackers.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        experiment = document["results"][EXPERIMENT]
        kinds = [analysis["type"] for analysis in experiment["parameters"]["analyses"]]
        # A grid of a tracker a row and one column is written as a list of its cells.
        grids = dict(zip(kinds, experiment["results"], strict=True))
        listed = list(document["trackers"])
        return [
            _official({kind: grid[listed.index(i)] for kind, grid in grids.items()})
            for i in identifiers
        ]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ValueError(
            f"{path} is not the analysis of {', '.join(identifiers)} in {stack.name} "
            f"({type(error).__name__}: {error}); expected what vot-toolkit 0.9.0 writes"
        ) from error


def _official(cells: dict[str, Any]) -> OfficialScores:
    accuracy, robustness, (reliability, _), _ = cells[
        "vot.analysis.supervised.AverageAccuracyRobustness"
    ]
    failures = cells.get("vot.analysis.failures.CumulativeFailureCount")
    eao = cells.get("vot.analysis.supervised.EAOScore")
    return OfficialScores(
        accuracy=float(accuracy),
        robustness=float(robustness),
        reliability=float(reliability),
        failures=None if failures is None else float(failures[0]),
        eao=None if eao is None else float(eao[0]),
    )


def _read_sequence_runs(workspace: Path, identifier: str, name: str, repetitions: int) -> VotRuns:
    folder = workspace / "results" / identifier / EXPERIMENT / name
    paths = [folder / f"{name}_{number:03d}.txt" for number in range(1, repetitions + 1)]
    paths = [path for path in paths if path.is_file()]
    if not paths:
        raise FileNotFoundError(
            f"{folder} has no trajectory {name}_001.txt; expected the results of the toolkit: "
            "run without --no-run"
        )
    sequence = workspace / "sequences" / name
    properties = dict(
        line.split("=", 1)
        for line in (sequence / "sequence").read_text(encoding="utf-8").splitlines()
        if "=" in line
    )
    truth, polygons = read_truth(sequence / "groundtruth.txt")
    size = (int(properties["width"]), int(properties["height"]))
    tracks = [_read_trajectory(path, truth) for path in paths]
    return VotRuns(name, truth, size, tracks, polygons)


def _read_trajectory(path: Path, truth: NDArray[np.float64]) -> SupervisedTrack:
    """A trajectory of the toolkit: a code or a rectangle a line."""
    lines = path.read_text(encoding="utf-8").split()
    if len(lines) != len(truth):
        raise ValueError(
            f"{path} has {len(lines)} lines, but the sequence {len(truth)} frames; expected as "
            "many: delete it and run again"
        )
    boxes = np.full((len(lines), 4), np.nan)
    steps = np.empty(len(lines), dtype=np.int8)
    for index, line in enumerate(lines):
        steps[index] = _CODES.get(line, Step.FOLLOWED)
        if steps[index] == Step.STARTED:
            boxes[index] = truth[index]
        elif steps[index] == Step.FOLLOWED:
            fields = line.split(",")
            if len(fields) != 4:
                raise ValueError(
                    f"{path}, line {index + 1}: {line!r} is neither a rectangle x,y,width,height "
                    "nor one of the codes 0, 1 and 2"
                )
            boxes[index] = [float(field) for field in fields]
    return SupervisedTrack(boxes, steps, np.full(len(lines), np.nan))
