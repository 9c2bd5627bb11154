"""The whole measurement of `re3 bench`: contenders, numbers of objects, crop sizes, memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from re3.benchmark.contenders import Entry
from re3.benchmark.footage import Footage
from re3.benchmark.measure import Timing, take_turns
from re3.benchmark.memory import Memory, memory_of
from re3.evaluation.environment import Environment

TOO_SLOW = 0.5
"""A contender that takes longer than so many seconds a frame is not given more objects."""

FEWEST_FRAMES = 5
"""Updates a turn at least, however many objects there are."""


@dataclass(frozen=True)
class Plan:
    """What to measure.

    Attributes:
        entries: the contenders; the first is what others are compared with.
        objects: numbers of objects, each measured by itself.
        sized: side of the crop in pixels -> contender with that crop, measured with one object.
        rounds: turns of each contender.
        frames: updates a turn with one object; with several, fewer.
        memory: also measure memory, each contender in a process of its own.
    """

    entries: Sequence[Entry]
    objects: Sequence[int] = (1,)
    sized: dict[int, Entry] = field(default_factory=dict)
    rounds: int = 5
    frames: int = 40
    memory: bool = True


@dataclass(frozen=True, eq=False)
class Study:
    """What was measured.

    Attributes:
        plan, footage: of what.
        environment: machine, date and versions.
        timings: number of objects -> contender -> its times.
        by_crop: side of the crop in pixels -> times with one object.
        memory: contender -> memory; empty where it was not asked for.
        skipped: what was left out, and why.
    """

    plan: Plan
    footage: Footage
    environment: Environment
    timings: dict[int, dict[str, Timing]]
    by_crop: dict[int, Timing]
    memory: dict[str, Memory]
    skipped: list[str]

    @property
    def first(self) -> Entry:
        """The contender that others are compared with."""
        return self.plan.entries[0]

    def of(self, name: str) -> dict[int, Timing]:
        """Times of one contender by number of objects."""
        return {n: found[name] for n, found in self.timings.items() if name in found}


def run_study(
    plan: Plan, footage: Footage, on_turn: Callable[[str], None] = lambda _: None
) -> Study:
    """Measure all that is planned; takes a while.

    Args:
        plan: with one contender or more.
        footage: frames in memory.
        on_turn: told what is measured next.

    Raises:
        ValueError: the plan has no contenders, two of one name, or numbers below 1.
        Whatever a contender raises.
    """
    names = [entry.name for entry in plan.entries]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"contenders are {names}; expected one or more, each with its own name")
    environment = Environment.here()
    contenders = {entry.name: entry.make() for entry in plan.entries}
    timings: dict[int, dict[str, Timing]] = {}
    skipped = []
    for objects in sorted(set(plan.objects)):
        running = {
            name: contender
            for name, contender in contenders.items()
            if all(t[name].latency.p50 < TOO_SLOW for t in timings.values() if name in t)
        }
        skipped += [
            f"{name} is not measured with {objects} objects: with fewer a frame took over "
            f"{TOO_SLOW:g} s"
            for name in contenders.keys() - running.keys()
        ]
        if running:
            timings[objects] = take_turns(
                running,
                footage,
                objects=objects,
                rounds=plan.rounds,
                frames=max(FEWEST_FRAMES, plan.frames // objects),
                on_turn=lambda name, n=objects: on_turn(f"{name}, {n} objects"),  # type: ignore[misc]
            )
    by_crop = {}
    if plan.sized:
        sized = {str(size): entry.make() for size, entry in plan.sized.items()}
        told = take_turns(
            sized,
            footage,
            rounds=plan.rounds,
            frames=plan.frames,
            on_turn=lambda size: on_turn(f"crops of {size} px"),
        )
        by_crop = {int(size): timing for size, timing in told.items()}
    memory = {}
    if plan.memory:
        for entry in plan.entries:
            on_turn(f"memory of {entry.name}")
            memory[entry.name] = memory_of(entry)
    return Study(plan, footage, environment, timings, by_crop, memory, skipped)
