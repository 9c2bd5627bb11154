"""What `re3 track` says at its end."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from re3.apps.stopping import StopSignals
from re3.apps.tracking import Tracked

NUMBERS_SHOWN = 20
"""Numbers of damaged frames that are given at most."""


@dataclass(frozen=True)
class Run:
    """What there is to tell of a run.

    Attributes:
        source: what was tracked, by name.
        outcome: of the tracking.
        written: files and the number of frames in each.
        stopped: what asked to stop, if anything did.
    """

    source: str
    outcome: Tracked
    written: dict[Path, int]
    stopped: StopSignals


def summarise(console: Console, run: Run, *, told: bool) -> None:
    """Say what came of it; `told` if the boxes went anywhere."""
    outcome = run.outcome

    def say(text: str, style: str | None = None) -> None:
        console.print(text, style=style, markup=False)

    if outcome.interrupted:
        say(f"stopped by {run.stopped.name} after {outcome.frames} frames", "yellow")
    if outcome.broken is not None:
        say(f"stopped early: {outcome.broken}", "yellow")
    if outcome.missing:
        say(
            f"note: {run.source} announces {outcome.missing} frames more than it gave; "
            "is it complete?",
            "yellow",
        )
    if outcome.skipped:
        say(f"note: {_skipped(outcome)}", "yellow")
    if outcome.damaged:
        say(f"note: {_damaged(outcome)}", "yellow")
    for path, count in run.written.items():
        say(f"{path}: {count} frames")
    for result in outcome.last.values():
        x, y, w, h = result.box_xywh
        say(f"last box of {result.label}: {x:.1f},{y:.1f},{w:.1f},{h:.1f} ({result.status})")
    counts = ", ".join(f"{status} {count}" for status, count in outcome.statuses.items())
    say(f"{outcome.frames} frames; boxes by status: {counts}")
    if outcome.updates:
        crops, network = (
            1000 * seconds / outcome.updates
            for seconds in (outcome.crop_seconds, outcome.network_seconds)
        )
        whole = 1000 / outcome.fps
        say(
            f"tracking: {outcome.fps:.0f} FPS ({whole:.1f} ms a frame without decoding and "
            f"encoding: crops {crops:.1f}, network {network:.1f}, rest "
            f"{whole - crops - network:.1f})"
        )
    if not run.written and not told:
        say("nothing was written; --out FILE.mp4 or --results FILE.csv keep the boxes")


def _skipped(outcome: Tracked) -> str:
    packets = "packet was" if outcome.skipped == 1 else "packets were"
    return (
        f"{outcome.skipped} {packets} skipped that cannot be decoded; frames are numbered without "
        "them, their timestamps are right"
    )


def _damaged(outcome: Tracked) -> str:
    """Which frames are damaged."""
    count = len(outcome.damaged)
    numbers = ", ".join(str(index) for index in outcome.damaged[:NUMBERS_SHOWN])
    more = ", …" if count > NUMBERS_SHOWN else ""
    frames = "frame is" if count == 1 else "frames are"
    return f"{count} {frames} damaged, as the decoder says ({numbers}{more}); check the boxes there"
