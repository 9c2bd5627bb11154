"""Memory of a process, and of a contender in a process of its own."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from re3.benchmark.contenders import Entry
from re3.benchmark.footage import made_footage
from re3.benchmark.resident import peak_bytes, resident_bytes

FRAMES = 12


@dataclass(frozen=True)
class Memory:
    """Bytes that a process held in RAM.

    Attributes:
        resident: after some updates with one object.
        before: of that with all libraries, before the model was loaded.
        peak: the most at any time, loading included.
    """

    resident: int
    before: int
    peak: int


def memory_of(entry: Entry) -> Memory:
    """Memory of a fresh process in which a contender follows one object.

    Raises:
        Whatever making or running it raises.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(_run, entry).result()


def _run(entry: Entry) -> Memory:
    footage = made_footage(FRAMES)
    before = resident_bytes()
    contender = entry.make()
    contender.start(footage.frames[0], [footage.box_xywh])
    for frame in footage.frames[1:]:
        contender.update(frame)
    return Memory(resident_bytes(), before, peak_bytes())
