"""The memory inside one search: no recipe is handed to the scorer twice."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sfkit.errors import SfkitError
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search.records import Candidate


@dataclass(frozen=True)
class Scored:
    """An outcome, and whether the search knew it already."""

    outcome: Outcome
    repeated: bool


def score_once(past: Iterable[Candidate], recipes: Sequence[Recipe], scorer: Scorer) -> tuple[Scored, ...]:
    """Score recipes, the new ones among them in one call, so that an engine can run them in parallel.

    A recipe that failed before is not tried again: its first outcome stands.

    Args:
        past: every candidate the search has scored.
        recipes: what a generation proposes; may hold the same recipe more than once.
        scorer: asked once, with each new recipe once, in order; not at all where none is new.

    Returns:
        One entry a recipe, in order.

    Raises:
        SfkitError: the scorer did not answer with one outcome a recipe.
    """
    known = {candidate.recipe: candidate.outcome for candidate in past}
    # One question for all that is new, so that an engine can share it out among its workers.
    new = tuple(dict.fromkeys(recipe for recipe in recipes if recipe not in known))
    fresh = dict(zip(new, _ask(scorer, new), strict=True))
    # Of equal recipes in one question the first is the one that was scored.
    first = set(fresh)
    found = []
    for recipe in recipes:
        found.append(Scored((fresh if recipe in fresh else known)[recipe], repeated=recipe not in first))
        first.discard(recipe)
    return tuple(found)


def _ask(scorer: Scorer, recipes: tuple[Recipe, ...]) -> tuple[Outcome, ...]:
    outcomes = tuple(scorer(recipes)) if recipes else ()
    if len(outcomes) != len(recipes):
        raise SfkitError(
            f"scorer: found {len(outcomes)} outcomes for {len(recipes)} recipes, expected one each, in order"
        )
    return outcomes
