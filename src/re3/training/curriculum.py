"""The curriculum: which phase of a recipe training is in (Re3, sec. III-B)."""

from __future__ import annotations

from typing import Any

from re3.training.plateau import Plateau
from re3.training.recipe import Phase, Recipe


class Curriculum:
    """Moves from phase to phase: at plateaus of the loss, or by the fixed schedule.

    With a plateau rule a phase ends where its loss plateaus, and at the latest where the fixed
    schedule would end it; the last one lasts until the recipe's iterations are up.

    Attributes:
        index: of the phase, into the recipe's.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        self.index = recipe.phase_at(0)[0] if recipe.iterations else 0
        self._plateau = None if recipe.plateau is None else Plateau(recipe.plateau)

    @property
    def phase(self) -> Phase:
        """The phase of the next iteration."""
        return self.recipe.phases[self.index]

    def advance(self, iteration: int, loss: float) -> bool:
        """Take note of an iteration.

        Args:
            iteration: how many are done by now.
            loss: of the one just done, finite.

        Returns:
            whether the next iteration is in another phase.
        """
        if iteration >= self.recipe.iterations:
            return False
        index = self.recipe.phase_at(iteration)[0]
        if self._plateau is not None:
            ended = self._plateau.add(loss)
            index = max(index, self._after() if ended else self.index)
        moved = index != self.index
        if moved and self._plateau is not None:
            self._plateau.reset()
        self.index = index
        return moved

    def _after(self) -> int:
        """The phase after this one; phases without iterations are left out."""
        phases = self.recipe.phases
        later = (i for i in range(self.index + 1, len(phases)) if phases[i].iterations)
        return next(later, self.index)

    def state(self) -> dict[str, Any]:
        """All that `restore` needs."""
        return {
            "phase": self.index,
            "plateau": None if self._plateau is None else self._plateau.state(),
        }

    def restore(self, state: dict[str, Any], iteration: int) -> None:
        """Go on from what `state` gave after so many iterations, if need be by another recipe."""
        if iteration < self.recipe.iterations:
            self.index = self.recipe.phase_at(iteration)[0]
        if self._plateau is not None and state["plateau"] is not None:
            self.index = min(max(self.index, state["phase"]), len(self.recipe.phases) - 1)
            self._plateau.restore(state["plateau"])
