"""How many threads a step is worth."""

from __future__ import annotations

from numbers import Integral

from re3.cores import spare_cores

MOST = 4
"""A step of one object is short: more threads would wait for each other most of the time."""


def checked_threads(threads: int) -> int:
    """A number of threads as a user gives it, `usable_threads()` for 0.

    Raises:
        ValueError: not a whole number, or below 0.
    """
    if isinstance(threads, bool) or not isinstance(threads, Integral) or threads < 0:
        raise ValueError(
            f"threads is {threads!r}; expected a whole number, 1 or more, or 0 to choose by the "
            "processor"
        )
    return int(threads) or usable_threads()


def usable_threads() -> int:
    """One fewer than the cores that the process may use, at least 1 and at most `MOST`.

    The last core is left to whatever feeds the tracker. Threads of a step meet some hundred times
    in it, and spin meanwhile: where another program, the decoder, say, holds one of the cores, all
    of them wait. On two cores, with another program on each, a step of re3-lite took 24 ms with
    two threads and 10 ms with one; on idle cores 4.3 and 6.7 ms (`docs/speed.md`).
    """
    return min(spare_cores(), MOST)
