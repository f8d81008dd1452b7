"""The scores of all subsets, on which searches compete without a forward pass."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from exhaustive import SubsetScores

from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search.operators import SubsetSpace


class Landscape:
    """A table of scores by bit mask, and the best of all subsets of two or more."""

    def __init__(self, table: SubsetScores, *, quick: bool = False) -> None:
        self.names = table.names
        self.mask = table.mask
        self.scores = table.quick if quick else table.scores
        self.space = SubsetSpace.free(len(table.names))
        self.best = min(score for mask, score in self.scores.items() if mask.bit_count() >= 2)

    def scored(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """As a scorer does: looks every recipe's sources up in the table."""
        return [Outcome(self.scores[self.mask(recipe.sources)]) for recipe in recipes]

    def regrets(self, masks: Iterable[int]) -> list[float]:
        """The regret after each distinct evaluation; a subset of one source costs, and wins nothing."""
        found, best = [], float("inf")
        for mask in dict.fromkeys(masks):
            if mask.bit_count() >= 2:
                best = min(best, self.scores[mask])
            found.append(best - self.best)
        return found
