"""Results out: CSV, JSON, JSON Lines, OTB and MOTChallenge text, COCO-style JSON."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from re3.video.results_base import ResultsWriter
from re3.video.results_lines import Csv, CsvToStdout, JsonLines, Mot, Otb
from re3.video.results_whole import Coco, Json

__all__ = ["ResultsWriter", "open_results"]

STDOUT = "-"


def open_results(path: str | Path, *, live: bool = False) -> ResultsWriter:
    """A writer chosen by the file's ending; used as a context manager.

    Args:
        path: ending in .csv, .jsonl, .json, .txt (OTB), .mot.txt (MOTChallenge) or .coco.json;
            "-" writes CSV to standard output.
        live: write .csv, .jsonl and .txt under their names, each frame as it comes and in complete
            lines, so that a process that is killed leaves the results up to there. An older file is
            lost with the first frame. The other forms are there at the end, whole or not at all.

    Raises:
        ValueError: another ending, or a folder.
    """
    if str(path) == STDOUT:
        return CsvToStdout()
    path = Path(path)
    kinds: dict[str, Callable[[Path], ResultsWriter]] = {
        ".mot.txt": lambda path: Mot(path, live),
        ".coco.json": Coco,
        ".csv": lambda path: Csv(path, live),
        ".jsonl": lambda path: JsonLines(path, live),
        ".json": Json,
        ".txt": lambda path: Otb(path, live),
    }
    ending = next((each for each in kinds if path.name.lower().endswith(each)), None)
    if ending is None:
        raise ValueError(
            f"results {path} end in {path.suffix!r}; expected one of "
            f"{', '.join(sorted(kinds, key=len))}, or - for CSV on standard output"
        )
    if path.is_dir():
        raise ValueError(f"results {path} is a folder; expected the path of a file")
    return kinds[ending](path)
