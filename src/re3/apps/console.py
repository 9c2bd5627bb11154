"""What all commands share in speaking to people: progress and errors go to stderr."""

from __future__ import annotations

import typer
from rich.console import Console

WRONG_INPUT = 2
"""Exit code after input that cannot be used."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def stderr() -> Console:
    """A console on standard error, so that standard output holds results alone."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def failed(message: object) -> typer.Exit:
    """Print an error line; raise what this returns to end the command."""
    stderr().print(f"error: {message}", style="red", markup=False)
    return typer.Exit(WRONG_INPUT)
