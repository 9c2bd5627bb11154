"""How many threads a step is worth."""

from __future__ import annotations

from re3.cores import spare_cores

MOST = 4
"""A step of one object is short: more threads would wait for each other most of the time."""


def usable_threads() -> int:
    """One fewer than the cores that the process may use, at least 1 and at most `MOST`.

    The last core is left to whatever feeds the tracker. Threads of a step meet some hundred times
    in it, and spin meanwhile: where another program, the decoder, say, holds one of the cores, all
    of them wait. On two cores, with another program on each, a step of re3-lite took 24 ms with
    two threads and 10 ms with one; on idle cores 4.3 and 6.7 ms (`docs/speed.md`).
    """
    return min(spare_cores(), MOST)
