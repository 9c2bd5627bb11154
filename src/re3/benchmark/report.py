"""A study as tables of text and as plain values for JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from re3.benchmark.advice import advice
from re3.benchmark.measure import Timing, over_rounds
from re3.benchmark.study import Study
from re3.evaluation.one_pass import Latency
from re3.evaluation.report_tables import Cell, TextTable, number, speed

PARTS = ("crop", "network", "rest", "update")


def tables(study: Study) -> list[TextTable]:
    """One a number of objects and, where measured, one of crop sizes and one of memory."""
    found = [_times(study, objects) for objects in study.timings]
    if study.by_crop:
        found.append(_by_crop(study))
    return [*found, _sizes(study)]


def _times(study: Study, objects: int) -> TextTable:
    timings = study.timings[objects]
    first = timings.get(study.first.name)
    rows = []
    for name, timing in timings.items():
        latency = timing.latency
        ratio = first.times_faster_than(timing) if first is not None else math.nan
        rows.append(
            [
                Cell(name),
                *(Cell(_ms(value)) for value in (latency.p50, latency.p95, latency.p99)),
                Cell(speed(timing.fps)),
                *(Cell(_ms(over_rounds(getattr(timing, part)).p50)) for part in PARTS[:3]),
                Cell(number(ratio, 2)),
            ]
        )
    header = ["tracker", "p50 ms", "p95 ms", "p99 ms", "FPS", "crop", "network", "rest"]
    title = f"{objects} object{'' if objects == 1 else 's'}: time of an update"
    return TextTable(title, [*header, "time / first"], rows)


def _by_crop(study: Study) -> TextTable:
    rows = [
        [
            Cell(f"{size} px"),
            Cell(_ms(timing.latency.p50)),
            Cell(speed(timing.fps)),
            Cell(_ms(over_rounds(timing.crop).p50)),
            Cell(_ms(over_rounds(timing.network).p50)),
        ]
        for size, timing in sorted(study.by_crop.items())
    ]
    header = ["side of the crop", "p50 ms", "FPS", "crop", "network"]
    return TextTable("re3-lite with other crops, untrained: speed alone", header, rows)


def _sizes(study: Study) -> TextTable:
    rows = []
    for entry in study.plan.entries:
        size = entry.size_bytes
        cells = [Cell(entry.name), Cell(f"{size / 1e6:.1f}" if size else "-")]
        if entry.name in study.memory:
            memory = study.memory[entry.name]
            values = (memory.resident, memory.resident - memory.before, memory.peak)
            cells += [Cell(f"{value / 1e6:.0f}") for value in values]
        rows.append(cells)
    header = ["tracker", "model MB"]
    if study.memory:
        header += ["memory MB", "of it the tracker's", "peak MB"]
    return TextTable("Size of the model, memory of a process that follows one object", header, rows)


def as_json(study: Study) -> dict[str, Any]:
    """Everything measured; times in seconds, sizes in bytes, NaN as None."""
    return {
        "environment": asdict(study.environment),
        "footage": {
            "name": study.footage.name,
            "frames": len(study.footage.frames),
            "size": list(study.footage.frames[0].shape[1::-1]),
            "box_xywh": list(study.footage.box_xywh),
        },
        "rounds": study.plan.rounds,
        "trackers": [
            {
                "name": entry.name,
                "model": entry.model,
                "engine": entry.engine if entry.ours else None,
                "threads": entry.threads,
                "size_bytes": entry.size_bytes,
                "memory": asdict(study.memory[entry.name]) if entry.name in study.memory else None,
                "times": [_timing_json(t) for t in study.of(entry.name).values()],
            }
            for entry in study.plan.entries
        ],
        "crop_sizes": [
            {"crop_size": size, **_timing_json(timing)} for size, timing in study.by_crop.items()
        ],
        "skipped": study.skipped,
        "advice": advice(study),
    }


def _timing_json(timing: Timing) -> dict[str, Any]:
    parts = {part: _latency_json(over_rounds(getattr(timing, part))) for part in PARTS}
    medians = [float(value) for value in np.median(timing.update, axis=1)]
    return {"objects": timing.objects, "fps": timing.fps, "round_p50": medians, **parts}


def _latency_json(latency: Latency) -> dict[str, float | None]:
    return {k: None if math.isnan(v) else v for k, v in asdict(latency).items()}


def _ms(seconds: float) -> str:
    return number(1000 * seconds, 2 if seconds < 0.01 else 1)
