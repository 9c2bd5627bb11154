"""What to choose on the machine that was measured, from the figures alone."""

from __future__ import annotations

import math

import numpy as np

from re3.benchmark.measure import Timing
from re3.benchmark.study import Study

VIDEO_RATE = 30.0
"""Frames a second that most cameras give."""

NEARLY = 1.15
"""Settings within this factor of each other are as good as the same."""

MOSTLY = 0.3
"""A part that takes more than this share of an update is worth a word."""


def advice(study: Study) -> list[str]:
    """Sentences, the most important first."""
    ours = [entry for entry in study.plan.entries if entry.ours]
    said: list[str] = []
    fastest = min(study.timings)
    known = {e.name: study.of(e.name)[fastest] for e in ours if fastest in study.of(e.name)}
    if known:
        name = min(known, key=lambda n: known[n].latency.p50)
        best = known[name]
        said.append(
            f"fastest of ours with {_objects(fastest)}: {name}, "
            f"{1000 * best.latency.p50:.1f} ms a frame ({best.fps:.0f} FPS)"
        )
        said += _frugal(study, name, known)
        said += _video_rate(name, study.of(name))
        said += _parts(best)
    said += _peers(study)
    if not math.isnan(study.environment.load) and study.environment.load > 0.5:
        said.append(
            f"the machine was busy before ({study.environment.load:.1f} processes wanted a core): "
            "ratios hold, times by themselves may be too long"
        )
    return said


def _frugal(study: Study, name: str, known: dict[str, Timing]) -> list[str]:
    """A contender of ours with fewer threads that is nearly as fast."""
    entries = {entry.name: entry for entry in study.plan.entries}
    chosen = entries[name]
    for other in sorted(known, key=lambda n: entries[n].threads or math.inf):
        entry = entries[other]
        same = (entry.model, entry.engine) == (chosen.model, chosen.engine)
        fewer = 0 < entry.threads < (chosen.threads or math.inf)
        if same and fewer and 1 / known[other].times_faster_than(known[name]) < NEARLY:
            return [f"{other} is nearly as fast and leaves cores to the rest of your program"]
    return []


def _video_rate(name: str, timings: dict[int, Timing]) -> list[str]:
    """How many objects it follows at the rate of a camera, or how many frames to leave out."""
    counts = np.array(sorted(timings), dtype=float)
    seconds = np.array([timings[int(n)].latency.p50 for n in counts])
    if seconds[0] > 1 / VIDEO_RATE:
        every = math.ceil(seconds[0] * VIDEO_RATE)
        return [
            f"a camera of {VIDEO_RATE:.0f} FPS is too fast for it: give it every {every}. frame"
        ]
    if seconds[-1] <= 1 / VIDEO_RATE:
        if len(counts) == 1:
            return []
        return [f"{VIDEO_RATE:.0f} FPS: {name} follows all {counts[-1]:.0f} objects measured"]
    # The time grows evenly from one number measured to the next.
    most = int(np.interp(1 / VIDEO_RATE, np.maximum.accumulate(seconds), counts))
    return [f"{VIDEO_RATE:.0f} FPS: {name} follows up to about {_objects(most)}"]


def _parts(timing: Timing) -> list[str]:
    whole = float(np.median(timing.update))
    shares = {
        "the network": float(np.median(timing.network)) / whole,
        "cutting crops": float(np.median(timing.crop)) / whole,
        "the rest": float(np.median(timing.rest)) / whole,
    }
    told = ", ".join(f"{part} {share:.0%}" for part, share in shares.items())
    more = (
        "; frames of half the width and height would save most of the crops' time"
        if shares["cutting crops"] > MOSTLY
        else ""
    )
    return [f"an update is {told}{more}"]


def _peers(study: Study) -> list[str]:
    said = []
    for objects, found in study.timings.items():
        if study.first.name not in found or objects != min(study.timings):
            continue
        mine = found[study.first.name]
        for entry in study.plan.entries:
            if entry.ours or entry.name not in found:
                continue
            ratio = mine.times_faster_than(found[entry.name])
            told = (
                f"{ratio:.2f} times as fast as"
                if ratio >= 1
                else f"{1 / ratio:.2f} times slower than"
            )
            said.append(f"{study.first.name} is {told} {entry.name} with {_objects(objects)}")
    return said


def _objects(count: int) -> str:
    return f"{count} object{'' if count == 1 else 's'}"
