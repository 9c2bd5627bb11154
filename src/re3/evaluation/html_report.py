"""A report as one HTML page that needs nothing beside it: plots, tables and the tracker's losses.

The page is `html_report.html.j2`; Jinja puts values into it and escapes them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from re3.evaluation.failures import Finding, Loss, explain, find_losses, frame_overlaps
from re3.evaluation.failures_strip import Strip, make_strip, overlap_svg
from re3.evaluation.plots_style import Style, inline_svg, require
from re3.evaluation.report_tables import (
    occlusion_tables,
    sequence_tables,
    speed_tables,
    summary_table,
    time_tables,
)
from re3.evaluation.sequence_result import SequenceResult
from re3.evaluation.summary import Run, notes

if TYPE_CHECKING:
    from re3.evaluation.plots import Plot

TEMPLATE = Path(__file__).with_name("html_report.html.j2")
MOST_STRIPS = 60
"""Losses shown in pictures, about 50 kB each; the others are listed with cause and curve."""


@dataclass(frozen=True, eq=False)
class LostTrack:
    """A sequence on which the tracker lost the object.

    Attributes:
        dataset, sequence: their names.
        frames: length of the track.
        losses: all of them; the first is the one shown.
        lost_share: share of the annotated frames that lie in losses, 0..1.
        finding: the likely cause of the first.
        curve: the overlap over time, an `<svg>`.
        strip: pictures of the first; None where they could not be read or were not wanted.
        unread: why they could not be read.
    """

    dataset: str
    sequence: str
    frames: int
    losses: list[Loss]
    lost_share: float
    finding: Finding
    curve: str
    strip: Strip | None
    unread: str | None = None


def to_html(
    run: Run,
    plots: Mapping[str, list[Plot]],
    styles: Mapping[str, Style],
    tracker: str | None = None,
) -> str:
    """The page.

    Args:
        run: with at least one result.
        plots: dataset -> its figures.
        styles: of all trackers.
        tracker: whose losses are shown, where the protocol is of one pass; the first by default.

    Raises:
        ImportError: the extra `report` is not installed.
    """
    jinja2 = require("jinja2")
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    shown = run.trackers[0] if tracker is None else tracker
    sections = [
        {
            "name": name or "sequences",
            "summary": summary_table(run, name),
            "speeds": [*speed_tables(run, name), *time_tables(run, name)],
            "figures": [
                (inline_svg(plot.figure, f"d{number}p{place}"), plot.caption, plot.wide)
                for place, plot in enumerate(plots.get(name, []))
            ],
            "by_sequence": sequence_tables(run, name),
        }
        for number, name in enumerate(run.datasets)
    ]
    of_shown = [
        result
        for result in run.results
        if result.tracker == shown and result.repeat == 0 and run.protocol.one_pass
    ]
    page: str = template.render(
        run=run,
        environment=run.environment,
        remarks=notes(run),
        sections=sections,
        occlusion=occlusion_tables(run),
        colours={name: style.colour for name, style in styles.items()},
        tracker=shown,
        tracked=len(of_shown),
        repeated=any(result.repeat for result in run.results),
        lost=lost_tracks(of_shown),
        most_strips=MOST_STRIPS,
        safe=jinja2.utils.markupsafe.Markup,
    )
    return page


def lost_tracks(results: list[SequenceResult]) -> list[LostTrack]:
    """The sequences on which a tracker lost its object, the worst first.

    Args:
        results: of one tracker in one pass. Frames of the sequences it lost are read again.
    """
    found = []
    for result in results:
        if result.track.unscored:
            continue
        overlaps = frame_overlaps(result.track.boxes_xywh, result.sequence.boxes_xywh)
        if losses := find_losses(overlaps):
            lost = np.zeros(len(overlaps), dtype=bool)
            for loss in losses:
                lost[loss.start : loss.end] = True
            share = float(lost[~np.isnan(overlaps)].mean())
            found.append((share, result, losses, overlaps))
    found.sort(key=lambda item: item[0], reverse=True)
    tracks = []
    for place, (share, result, losses, overlaps) in enumerate(found):
        sequence, boxes = result.sequence, result.track.boxes_xywh
        strip, unread = None, None
        if place < MOST_STRIPS:
            try:
                strip = make_strip(sequence, boxes, losses[0].start)
            except (ValueError, OSError) as error:
                unread = str(error)
        tracks.append(
            LostTrack(
                dataset=sequence.dataset,
                sequence=sequence.name,
                frames=len(sequence),
                losses=losses,
                lost_share=share,
                finding=explain(
                    losses[0],
                    boxes,
                    sequence.boxes_xywh,
                    sequence.occluded,
                    strip.frame_size if strip is not None else None,
                ),
                curve=overlap_svg(overlaps, [(loss.start, loss.end) for loss in losses]),
                strip=strip,
                unread=unread,
            )
        )
    return tracks
