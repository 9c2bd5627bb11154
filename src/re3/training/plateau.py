"""Plateau detection: when the loss has stopped falling (Re3, sec. III-B).

The paper doubles the unrolls "after the loss plateaus" and leaves open what that is. Here it is the
plainest rule that noise of single batches does not trip: means over windows of iterations, and a
number of windows in a row that are no better than the best one before them.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from re3.training.recipe import PlateauRule


@dataclass
class PlateauState:
    """What has been seen of the loss since the last reset.

    Attributes:
        total, count: sum and number of the losses in the window that is being filled.
        best: mean of the last window that was better than all before; infinite before the first.
        stale: windows in a row that were not better than the best.
    """

    total: float = 0.0
    count: int = 0
    best: float = math.inf
    stale: int = 0


class Plateau:
    """Watches a loss, one value an iteration.

    Args:
        rule: what counts as a plateau.
    """

    def __init__(self, rule: PlateauRule) -> None:
        self.rule = rule
        self.seen = PlateauState()

    def add(self, loss: float) -> bool:
        """Note the loss of an iteration; says whether that makes it a plateau.

        Raises:
            ValueError: the loss is not finite.
        """
        if not math.isfinite(loss):
            raise ValueError(f"the loss is {loss}; expected a finite number to compare with others")
        seen = self.seen
        seen.total += loss
        seen.count += 1
        if seen.count < self.rule.window:
            return False
        mean = seen.total / seen.count
        seen.total, seen.count = 0.0, 0
        # The best stays where a window is only a little below it: a slow fall adds up.
        if math.isinf(seen.best) or mean < seen.best - self.rule.improvement * abs(seen.best):
            seen.best, seen.stale = mean, 0
        else:
            seen.stale += 1
        return seen.stale >= self.rule.patience

    def reset(self) -> None:
        """Forget everything: another phase has another loss."""
        self.seen = PlateauState()

    def state(self) -> dict[str, float]:
        """All that `restore` needs."""
        return asdict(self.seen)

    def restore(self, state: dict[str, float]) -> None:
        """Go on from what `state` gave."""
        self.seen = PlateauState(
            float(state["total"]), int(state["count"]), float(state["best"]), int(state["stale"])
        )
