"""Options that several commands share, said once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PeersOption = Annotated[
    Path | None,
    typer.Option(
        "--peers",
        help="Folder with the files of peer trackers (nanotrack/v1 to v3, fear). Default: "
        "the environment's RE3_PEERS, or ../shared/peers.",
        metavar="DIR",
        show_default=False,
    ),
]

SequencesOption = Annotated[
    str | None,
    typer.Option(
        "--sequences",
        "-s",
        help="Only these, separated by commas; a clip's name stands for all its tracks.",
        metavar="A,B",
        show_default=False,
    ),
]

ShortTruthOption = Annotated[
    bool,
    typer.Option(
        "--short-truth",
        help="Score clips whose annotation ends before they do over the frames that have a line; "
        "without, they are refused.",
    ),
]

IntervalOption = Annotated[
    str | None,
    typer.Option(
        "--interval",
        help="Shortest and longest length in frames that VOT's EAO averages over, instead of the "
        "challenge's; for sequences shorter than those of the challenge.",
        metavar="LOW,HIGH",
        show_default=False,
    ),
]
