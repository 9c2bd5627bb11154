"""A run as data for other programs: `results.json` and `results.csv`."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import asdict
from typing import Any

from re3.csv_text import csv_text
from re3.evaluation.occlusion import attribute_means, occlusion_table
from re3.evaluation.one_pass import decode_time, frames_per_second
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.summary import Run, notes
from re3.evaluation.time_parts import time_parts


def results_json(run: Run) -> str:
    """Everything as JSON; figures that are not defined are null."""
    document: dict[str, Any] = {
        "command": run.command,
        "data": list(run.data),
        "protocol": run.protocol.name,
        "conventions": run.protocol.conventions,
        "jobs": run.jobs,
        "timing_is_comparable": run.timing_is_comparable,
        "environment": asdict(run.environment),
        "notes": notes(run),
        "summary": [
            {
                "dataset": row.dataset,
                "tracker": row.tracker,
                "sequences": row.sequences,
                "failed": row.failed,
                "figures": row.figures.mean,
                "spread": row.figures.spread,
                "fps": row.fps,
                "latency_seconds": asdict(row.latency),
                "decode_seconds": row.decode_seconds,
                "crop_seconds": row.parts.crop.p50,
                "network_seconds": row.parts.network.p50,
                "parts_seconds": asdict(row.parts),
            }
            for row in run.tracker_rows
        ],
        "sequences": [_sequence_record(run, result) for result in run.results],
    }
    if run.protocol.one_pass:
        document["occlusion"] = [asdict(row) for row in occlusion_table(run.results)]
        document["attributes"] = [asdict(row) for row in attribute_means(run.results)]
    return json.dumps(without_nan(document), indent=2, allow_nan=False) + "\n"


def results_csv(run: Run) -> str:
    """A line for each run of a tracker over a sequence; figures that are not defined are empty."""
    records = [_sequence_record(run, result) for result in run.results]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(records[0]) if records else [], lineterminator="\n")
    writer.writeheader()
    for record in records:
        writer.writerow({name: _cell(value) for name, value in record.items()})
    return stream.getvalue()


def _sequence_record(run: Run, result: SequenceResult) -> dict[str, Any]:
    track, times, parts = result.track, result.track.latency, time_parts([result.track])
    record: dict[str, Any] = {
        "dataset": result.sequence.dataset,
        "sequence": result.sequence.name,
        "tracker": result.tracker,
        "repeat": result.repeat + 1,
        "frames": len(result.sequence),
    }
    # Of one pass, whichever protocol, each sequence has all of its scores.
    figures = asdict(result.scores) if run.protocol.one_pass else run.figures_of([result])
    for name, value in figures.items():
        # The ablation study has a count of frames of its own: of the annotated ones.
        record.setdefault(name, value)
    return record | {
        "fps": frames_per_second([track]),
        "p50_seconds": times.p50,
        "p95_seconds": times.p95,
        "p99_seconds": times.p99,
        "decode_seconds": decode_time([track]),
        "crop_seconds": parts.crop.p50,
        "network_seconds": parts.network.p50,
        "reused": result.reused,
        "failure": track.failure,
    }


def _cell(value: Any) -> Any:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, str):
        return csv_text(value)
    return value


def without_nan(value: Any) -> Any:
    """A document for JSON, which has no NaN: null in its place."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
